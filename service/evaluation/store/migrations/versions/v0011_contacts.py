"""Chunks say how the ego and another vehicle touched; those that are there do not."""

import sqlalchemy as sa
from alembic import op

revision = "0011"
down_revision = "0010"


def upgrade() -> None:
    op.add_column("chunks", sa.Column("contacts", sa.Text))
