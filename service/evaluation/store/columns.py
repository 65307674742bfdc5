"""Columns of the record's tables, several at once, by name and kind."""

from __future__ import annotations

import sqlalchemy as sa


def keys(**kinds: type[sa.types.TypeEngine]) -> list[sa.Column]:
    """Columns that together are a table's primary key; none of them is counted up by the database."""
    return [sa.Column(name, kind, primary_key=True, autoincrement=False) for name, kind in kinds.items()]


def needed(**kinds: type[sa.types.TypeEngine]) -> list[sa.Column]:
    """Columns that every row has a value in."""
    return [sa.Column(name, kind, nullable=False) for name, kind in kinds.items()]
