"""The last states of jobs that are over, so that their estimates are told without a replay."""

from alembic import op
from sqlalchemy import Integer, LargeBinary, Text

from service.evaluation.store.columns import keys, needed

revision = "0003"
down_revision = "0002"


def upgrade() -> None:
    op.create_table(
        "states",
        *keys(job=Text, epoch=Integer, tailroad=Text),
        *needed(number=Integer, state=LargeBinary, at=Text),
    )
