"""The record of a run directory: chunks."""

from alembic import op
from sqlalchemy import Float, Integer, LargeBinary, Text

from service.evaluation.store.columns import keys, needed

revision = "0001"
down_revision = None


def upgrade() -> None:
    op.create_table(
        "chunks",
        *keys(job=Text, phase=Text, iteration=Integer, start=Integer),
        *needed(
            stop=Integer, f=LargeBinary, outcomes=LargeBinary, steps=LargeBinary, errors=Text, worker_s=Float
        ),
    )
