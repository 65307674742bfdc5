"""Chunks and iterations carry a checksum; those that are there have none, and are read as they are."""

import sqlalchemy as sa
from alembic import op

revision = "0005"
down_revision = "0004"


def upgrade() -> None:
    for table in ("chunks", "iterations"):
        op.add_column(table, sa.Column("checksum", sa.Text, nullable=False, server_default=""))
