"""Opens a database by its URL: SQLite or PostgreSQL, brought to this version's schema.

The schema's versions are Alembic's (`migrations/versions`). A new database is made at the newest version at once; one
of an earlier version, a run directory's of before there were versions among them, is migrated in one transaction.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from weakref import WeakKeyDictionary

import sqlalchemy as sa
from sqlalchemy.dialects import postgresql, sqlite
from sqlalchemy.exc import ArgumentError, NoSuchModuleError, OperationalError, SQLAlchemyError

from service.errors import StoreError, StoreOutage, Superseded
from service.evaluation.store import tables

SQLITE_HEAD = b"SQLite format 3\x00"
SCHEDULER = "scheduler"  # the lease of who may write to a fleet's database
LOCK_WAIT_S = 5.0  # for another process that writes to the same SQLite file
_MIGRATION_LOCK = 0x7461696C  # any number: PostgreSQL's advisory lock while the schema is made


def sqlite_url(path: Path) -> str:
    return f"sqlite:///{path}"


def open_engine(url: str, lock_wait_s: float = LOCK_WAIT_S, new: bool = True) -> sa.Engine:
    """An engine for the database at `url`, with this version's tables; StoreError where that cannot be.

    new: make the tables of a database that has none, instead of refusing it
    """
    try:
        engine = _engine(url, lock_wait_s)
    except (ArgumentError, NoSuchModuleError) as error:
        raise StoreError(
            f"not a database URL: {error}; give sqlite:///FILE or postgresql+psycopg://USER@HOST/NAME"
        ) from error
    except ModuleNotFoundError as error:
        raise StoreError(f"this database needs {error.name}; install tailroad[postgres]") from error
    try:
        _prepare(engine, new)
    except (SQLAlchemyError, UnicodeError) as error:  # SQLite quotes a damaged file's bytes in its messages
        engine.dispose()
        raise StoreError(f"cannot open {shown(engine)}: {reason(error)}") from error
    except StoreError:
        engine.dispose()
        raise
    return engine


def _engine(url: str, lock_wait_s: float) -> sa.Engine:
    parsed = sa.make_url(url)
    if parsed.get_backend_name() == "sqlite":
        engine = sa.create_engine(parsed, connect_args={"timeout": lock_wait_s})
        sa.event.listen(engine, "connect", _configure_sqlite)
        sa.event.listen(engine, "begin", _begin)
        return engine
    if parsed.get_backend_name() == "postgresql":
        return sa.create_engine(parsed, pool_pre_ping=True)
    raise ArgumentError(f"{parsed.get_backend_name()} is not a kind that tailroad keeps records in")


def _configure_sqlite(connection: Any, _record: object) -> None:
    """Readers do not wait for the writer, and a finished chunk survives a kill of the process."""
    connection.isolation_level = None  # transactions are begun below, so that tables are made in one, too
    cursor = connection.cursor()
    cursor.execute("PRAGMA journal_mode=WAL")
    cursor.execute("PRAGMA synchronous=NORMAL")
    cursor.close()


def _begin(connection: sa.Connection) -> None:
    writes = connection.get_execution_options().get("writes", False)
    connection.exec_driver_sql("BEGIN IMMEDIATE" if writes else "BEGIN")


@contextmanager
def writing(engine: sa.Engine) -> Iterator[sa.Connection]:
    """A transaction that will write: it waits for other writers before it reads anything.

    Superseded where the engine is fenced (`fence`) and another scheduler has claimed the database since.
    """
    with engine.connect().execution_options(writes=True) as connection, connection.begin():
        if engine in _EPOCHS:
            _check_epoch(engine, connection)
        yield connection


_EPOCHS: WeakKeyDictionary[sa.Engine, int] = WeakKeyDictionary()


def fence(engine: sa.Engine, epoch: int) -> None:
    """Have every write from now on look whether this is still the scheduler's epoch, in its own transaction."""
    _EPOCHS[engine] = epoch


def _check_epoch(engine: sa.Engine, connection: sa.Connection) -> None:
    query = sa.select(tables.leases.c.epoch, tables.leases.c.holder).where(tables.leases.c.name == SCHEDULER)
    row = connection.execute(query.with_for_update(read=True)).first()  # a claim waits for this transaction
    if row is None or row.epoch != _EPOCHS[engine]:
        holder = "another scheduler" if row is None else f"the scheduler of {row.holder}"
        raise Superseded(
            f"{holder} has taken over {shown(engine)}; this one ends: what it has recorded is in the database"
        )


def read_rows(engine: sa.Engine, query: sa.Select) -> list[sa.Row]:
    """All rows of a query; StoreError where they cannot be read."""
    try:
        with engine.connect() as connection:
            return list(connection.execute(query))
    except SQLAlchemyError as error:
        raise cannot_read(engine, error) from error


def cannot_read(engine: sa.Engine, error: Exception) -> StoreError:
    """What is told of it: StoreOutage where another try may go well."""
    kind = StoreOutage if isinstance(error, OperationalError) else StoreError
    return kind(f"cannot read {shown(engine)}: {reason(error)}")


def check_sqlite_file(engine: sa.Engine) -> None:
    """StoreError where the file is gone or is no database any more: connections that are open do not notice."""
    name = str(engine.url.database or "")
    if name in ("", ":memory:"):
        return
    try:
        with Path(name).open("rb") as file:
            head = file.read(len(SQLITE_HEAD))
    except OSError as error:
        raise StoreError(f"cannot read {name}: {error.strerror}") from error
    if head != SQLITE_HEAD:
        raise StoreError(f"{name} is damaged: it is no SQLite database any more; take it from a copy")


def insert_once(engine: sa.Engine, table: sa.Table) -> postgresql.Insert | sqlite.Insert:
    """An insert that leaves a row that is there already as it is."""
    kind = postgresql if engine.dialect.name == "postgresql" else sqlite
    return kind.insert(table).on_conflict_do_nothing()


def add_to_tally(engine: sa.Engine) -> postgresql.Insert | sqlite.Insert:
    """An insert into tallies that adds to a row that is there already."""
    kind = postgresql if engine.dialect.name == "postgresql" else sqlite
    row = kind.insert(tables.tallies)
    more = {"chunks": tables.tallies.c.chunks + row.excluded.chunks}
    return row.on_conflict_do_update(index_elements=[tables.tallies.c.job], set_=more)


def reason(error: Exception) -> str:
    """What the database itself said."""
    return str(error.__cause__ or error).strip()


def shown(engine: sa.Engine) -> str:
    """The database as messages name it: a file's path, or the URL without its password."""
    if engine.dialect.name == "sqlite":
        return str(engine.url.database)
    return engine.url.render_as_string(hide_password=True)


def _prepare(engine: sa.Engine, new: bool) -> None:
    with engine.connect() as connection:
        if _version(connection) == tables.VERSION:
            return
    with writing(engine) as connection:
        if engine.dialect.name == "postgresql":
            connection.execute(sa.select(sa.func.pg_advisory_xact_lock(_MIGRATION_LOCK)))
        version = _version(connection)  # another process may have been first
        if version == tables.VERSION:
            return
        if version is None and not sa.inspect(connection).has_table("chunks"):
            if not new:
                raise StoreError(f"{shown(engine)} holds no record of rollouts")
            tables.metadata.create_all(connection)
            _stamp(connection)
        else:
            _migrate(connection, version, shown(engine))


def _version(connection: sa.Connection) -> str | None:
    """The schema's version; None for a database without one."""
    if not sa.inspect(connection).has_table("alembic_version"):
        return None
    return connection.scalar(sa.text("SELECT version_num FROM alembic_version"))


def _stamp(connection: sa.Connection) -> None:
    connection.execute(sa.text("CREATE TABLE alembic_version (version_num VARCHAR(32) NOT NULL PRIMARY KEY)"))
    connection.execute(sa.text("INSERT INTO alembic_version VALUES (:v)"), {"v": tables.VERSION})


def _migrate(connection: sa.Connection, version: str | None, where: str) -> None:
    # Alembic takes as long to import as everything else here together, and is seldom needed
    from alembic import command
    from alembic.config import Config
    from alembic.script import ScriptDirectory

    config = Config()
    config.set_main_option("script_location", str(Path(__file__).parent / "migrations"))
    config.attributes["connection"] = connection
    if version is None:
        command.stamp(config, "0001")  # a run directory of before there were versions
    elif version not in {script.revision for script in ScriptDirectory.from_config(config).walk_revisions()}:
        raise StoreError(
            f"{where} has schema version {version}, which is later than this tailroad's ({tables.VERSION}); "
            "use the tailroad that made it, or a later one"
        )
    command.upgrade(config, "head")
