"""Versions of the record's schema, for Alembic."""
