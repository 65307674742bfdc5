"""What a fleet needs: who ran a chunk, of which rows, epochs and voids, audits, jobs and what they tell, quarantine."""

import sqlalchemy as sa
from alembic import op

revision = "0002"
down_revision = "0001"

CHUNK_KEY = (("job", sa.Text), ("phase", sa.Text), ("iteration", sa.Integer), ("start", sa.Integer),
             ("epoch", sa.Integer))  # fmt: skip


def _key(*names_and_kinds: tuple[str, type]) -> list[sa.Column]:
    return [sa.Column(n, k, primary_key=True, autoincrement=False) for n, k in names_and_kinds]


def _columns(*names_and_kinds: tuple[str, type]) -> list[sa.Column]:
    return [sa.Column(n, k, nullable=False) for n, k in names_and_kinds]


def upgrade() -> None:
    op.rename_table("chunks", "chunks_0001")
    op.create_table(
        "chunks",
        *_key(*CHUNK_KEY),
        *_columns(("stop", sa.Integer), ("f", sa.LargeBinary), ("outcomes", sa.LargeBinary),
                  ("steps", sa.LargeBinary), ("errors", sa.Text), ("worker_s", sa.Float),
                  ("digest", sa.Text), ("worker", sa.Text)),
    )  # fmt: skip
    op.execute(
        "INSERT INTO chunks SELECT job, phase, iteration, start, 0, stop, f, outcomes, steps, errors, worker_s, '', '' "
        "FROM chunks_0001"
    )
    op.drop_table("chunks_0001")
    op.create_index("chunks_by_worker", "chunks", ["worker"])
    op.create_table(
        "voids",
        *_key(*CHUNK_KEY),
        *_columns(("next_epoch", sa.Integer), ("reason", sa.Text), ("at", sa.Text)),
    )
    op.create_table("audits", *_key(*CHUNK_KEY, ("worker", sa.Text)), *_columns(("at", sa.Text)))
    op.create_table(
        "jobs",
        *_key(("id", sa.Text)),
        sa.Column("number", sa.Integer, nullable=False, unique=True),
        *_columns(("spec", sa.Text), ("priority", sa.Integer), ("weight", sa.Float), ("label", sa.Text),
                  ("at", sa.Text)),
    )  # fmt: skip
    op.create_table(
        "events",
        *_key(("job", sa.Text), ("number", sa.Integer)),
        *_columns(("kind", sa.Text), ("body", sa.Text), ("at", sa.Text)),
    )
    op.create_index("events_by_kind", "events", ["job", "kind", "number"])
    op.create_table(
        "iterations",
        *_key(("job", sa.Text), ("epoch", sa.Integer), ("number", sa.Integer)),
        *_columns(("record", sa.Text), ("at", sa.Text)),
    )
    op.create_table("quarantine", *_key(("worker", sa.Text)), *_columns(("reason", sa.Text), ("at", sa.Text)))
