"""What a job keeps beside its chunks: committors, states between its batches, how its paths ended."""

from alembic import op
from sqlalchemy import LargeBinary, Text

from service.evaluation.store.columns import keys, needed

revision = "0008"
down_revision = "0007"


def upgrade() -> None:
    op.create_table("artefacts", *keys(job=Text, name=Text), *needed(data=LargeBinary, checksum=Text))
