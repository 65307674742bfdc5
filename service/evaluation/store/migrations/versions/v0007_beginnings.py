"""What jobs were begun with, and how many chunks of each were ever recorded; of earlier jobs the chunks are counted."""

import sqlalchemy as sa
from alembic import op

revision = "0007"
down_revision = "0006"


def upgrade() -> None:
    op.create_table(
        "beginnings",
        sa.Column("job", sa.Text, primary_key=True, autoincrement=False),
        *(sa.Column(name, sa.Text, nullable=False) for name in ("spec", "software", "at", "checksum")),
    )
    op.create_table(
        "tallies",
        sa.Column("job", sa.Text, primary_key=True, autoincrement=False),
        sa.Column("chunks", sa.Integer, nullable=False),
    )
    op.execute("INSERT INTO tallies SELECT job, count(*) FROM chunks GROUP BY job")
