"""What jobs were begun with, and how many chunks of each were ever recorded; of earlier jobs the chunks are counted."""

from alembic import op
from sqlalchemy import Integer, Text

from service.evaluation.store.columns import keys, needed

revision = "0007"
down_revision = "0006"


def upgrade() -> None:
    op.create_table("beginnings", *keys(job=Text), *needed(spec=Text, software=Text, at=Text, checksum=Text))
    op.create_table("tallies", *keys(job=Text), *needed(chunks=Integer))
    op.execute("INSERT INTO tallies SELECT job, count(*) FROM chunks GROUP BY job")
