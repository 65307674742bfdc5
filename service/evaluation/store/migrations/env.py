"""Alembic's entry: migrates the connection that `service.evaluation.store.database` hands over, in its transaction."""

from alembic import context

from service.evaluation.store.tables import metadata

context.configure(connection=context.config.attributes["connection"], target_metadata=metadata)
context.run_migrations()
