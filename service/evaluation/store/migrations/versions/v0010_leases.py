"""Who is the scheduler: a lease with an epoch, so that an earlier one writes no more."""

from alembic import op
from sqlalchemy import Float, Integer, Text

from service.evaluation.store.columns import keys, needed

revision = "0010"
down_revision = "0009"


def upgrade() -> None:
    op.create_table("leases", *keys(name=Text), *needed(epoch=Integer, holder=Text, since=Float, until=Float))
