"""Which share of a job's rollouts may fail; of earlier jobs any may."""

import sqlalchemy as sa
from alembic import op

revision = "0009"
down_revision = "0008"


def upgrade() -> None:
    op.add_column("jobs", sa.Column("max_failed", sa.Float, nullable=False, server_default="1"))
