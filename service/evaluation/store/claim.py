"""One scheduler a database: a second one is refused while the first one lives, however it ends."""

import fcntl
from pathlib import Path
from typing import IO

import sqlalchemy as sa
from sqlalchemy.exc import SQLAlchemyError

from service.errors import StoreError
from service.evaluation.store.database import reason, shown

_LOCK = 0x74726F61  # any number: PostgreSQL's advisory lock of the scheduler


class Claim:
    """Held until closed, or until the process ends: a lock on a file beside SQLite's, or PostgreSQL's own."""

    def __init__(self, engine: sa.Engine):
        self._file: IO[str] | None = None
        self._connection: sa.Connection | None = None
        where = shown(engine)
        taken = StoreError(f"another scheduler works on {where}; stop it, or give this one another database")
        if engine.dialect.name == "sqlite":
            try:
                self._file = Path(f"{where}.lock").open("w")  # noqa: SIM115 (held until closed)
                fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                raise taken from None
            except OSError as error:
                raise StoreError(f"cannot lock {where}.lock: {error.strerror}") from error
            return
        try:
            self._connection = engine.connect()
            got = self._connection.scalar(sa.select(sa.func.pg_try_advisory_lock(_LOCK)))
            self._connection.commit()
        except SQLAlchemyError as error:
            raise StoreError(f"cannot lock {where}: {reason(error)}") from error
        if not got:
            self._connection.close()
            raise taken

    def close(self) -> None:
        if self._file is not None:
            self._file.close()
        if self._connection is not None:
            self._connection.invalidate()  # ends the database's session, and with it the lock
            self._connection.close()
