"""What a fleet needs: who ran a chunk, of which rows, epochs and voids, audits, jobs and what they tell, quarantine."""

import sqlalchemy as sa
from alembic import op
from sqlalchemy import Float, Integer, LargeBinary, Text

from service.evaluation.store.columns import keys, needed

revision = "0002"
down_revision = "0001"

CHUNK_KEY = {"job": Text, "phase": Text, "iteration": Integer, "start": Integer, "epoch": Integer}


def upgrade() -> None:
    op.rename_table("chunks", "chunks_0001")
    op.create_table(
        "chunks",
        *keys(**CHUNK_KEY),
        *needed(stop=Integer, f=LargeBinary, outcomes=LargeBinary, steps=LargeBinary, errors=Text, worker_s=Float,
                digest=Text, worker=Text),
    )  # fmt: skip
    op.execute(
        "INSERT INTO chunks SELECT job, phase, iteration, start, 0, stop, f, outcomes, steps, errors, worker_s, '', '' "
        "FROM chunks_0001"
    )
    op.drop_table("chunks_0001")
    op.create_index("chunks_by_worker", "chunks", ["worker"])
    op.create_table("voids", *keys(**CHUNK_KEY), *needed(next_epoch=Integer, reason=Text, at=Text))
    op.create_table("audits", *keys(**CHUNK_KEY, worker=Text), *needed(at=Text))
    op.create_table(
        "jobs",
        *keys(id=Text),
        sa.Column("number", Integer, nullable=False, unique=True),
        *needed(spec=Text, priority=Integer, weight=Float, label=Text, at=Text),
    )
    op.create_table("events", *keys(job=Text, number=Integer), *needed(kind=Text, body=Text, at=Text))
    op.create_index("events_by_kind", "events", ["job", "kind", "number"])
    op.create_table(
        "iterations", *keys(job=Text, epoch=Integer, number=Integer), *needed(record=Text, at=Text)
    )
    op.create_table("quarantine", *keys(worker=Text), *needed(reason=Text, at=Text))
