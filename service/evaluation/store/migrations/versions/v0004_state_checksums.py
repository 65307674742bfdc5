"""Last states say which record they are of and have a checksum; earlier ones have neither and are not used."""

import sqlalchemy as sa
from alembic import op

revision = "0004"
down_revision = "0003"


def upgrade() -> None:
    for name in ("record", "checksum"):
        op.add_column("states", sa.Column(name, sa.Text, nullable=False, server_default=""))
