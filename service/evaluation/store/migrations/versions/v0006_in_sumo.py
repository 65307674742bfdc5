"""Chunks say how many of their rollouts SUMO has driven; those that are there do not."""

import sqlalchemy as sa
from alembic import op

revision = "0006"
down_revision = "0005"


def upgrade() -> None:
    op.add_column("chunks", sa.Column("in_sumo", sa.Integer))
