"""Who told the service to do what: an audit log, to which rows can only be added."""

from alembic import op
from sqlalchemy import Integer, Text

from service.evaluation.store.columns import keys, needed
from service.evaluation.store.tables import APPEND_ONLY

revision = "0012"
down_revision = "0011"


def upgrade() -> None:
    op.create_table(
        "audit_log",
        *keys(number=Integer),
        *needed(at=Text, who=Text, did=Text, job=Text, refused=Text, hash=Text),
    )
    for statement in APPEND_ONLY[op.get_bind().dialect.name]:
        op.execute(statement)
