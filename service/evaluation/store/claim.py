"""One scheduler a database: a second one is refused while the first one lives, and an earlier one writes no more.

A lock tells whether the first one lives: on a file beside SQLite's, or PostgreSQL's own. PostgreSQL's is lost when the
server begins anew, though the scheduler lives, so that a lease is renewed beside it; and whoever claims the database
has a new epoch, which every write looks at in its own transaction.
"""

import fcntl
import logging
import os
import socket
import threading
import time
from contextlib import suppress
from pathlib import Path
from typing import IO

import sqlalchemy as sa
from sqlalchemy.exc import SQLAlchemyError

from service.errors import StoreError
from service.evaluation.store.database import SCHEDULER, fence, reason, shown
from service.evaluation.store.tables import leases

_LOCK = 0x74726F61  # any number: PostgreSQL's advisory lock of the scheduler
LEASE_S = 10.0
RENEW_S = 3.0

log = logging.getLogger("tailroad.store")


class Claim:
    """Held until closed, or until the process ends."""

    def __init__(self, engine: sa.Engine):
        self._engine = engine
        self._file: IO[str] | None = None
        self._connection: sa.Connection | None = None
        self._closing = threading.Event()
        self._renewing: threading.Thread | None = None
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
        try:
            if self._file is None and not (self._lock() and self._lease_is_over()):
                self._unlock()
                raise taken
            self._take()
        except SQLAlchemyError as error:
            self.close()
            raise StoreError(f"cannot lock {where}: {reason(error)}") from error
        if self._file is None:
            self._renewing = threading.Thread(target=self._renew, name="lease", daemon=True)
            self._renewing.start()

    def close(self) -> None:
        self._closing.set()
        if self._renewing is not None:
            self._renewing.join()
            self._release()
        if self._file is not None:
            self._file.close()
        self._unlock()

    # -- PostgreSQL's lock -----------------------------------------------------------------------------------

    def _lock(self) -> bool:
        """Whether PostgreSQL's lock is this process's."""
        self._connection = self._engine.connect()
        got = self._connection.scalar(sa.select(sa.func.pg_try_advisory_lock(_LOCK)))
        self._connection.commit()
        return bool(got)

    def _unlock(self) -> None:
        if self._connection is not None:
            with suppress(SQLAlchemyError):
                self._connection.scalar(sa.select(sa.func.pg_advisory_unlock(_LOCK)))
            self._connection.invalidate()  # ends the database's session, and with it the lock
            self._connection.close()
            self._connection = None

    def _lease_is_over(self) -> bool:
        """Whether nobody holds the lease whom a restart of the server cost its lock: one who lives renews it."""
        assert self._connection is not None
        started = sa.cast(sa.func.extract("epoch", sa.func.pg_postmaster_start_time()), sa.Float)
        query = sa.select(
            leases.c.until, leases.c.since, _now(self._engine).label("now"), started.label("started")
        )
        deadline = time.monotonic() + 2.0 * LEASE_S
        first: float | None = None
        while True:
            row = self._connection.execute(query.where(leases.c.name == SCHEDULER)).first()
            self._connection.commit()
            if row is None or row.since > row.started or row.until <= row.now:
                return True
            first = row.until if first is None else first
            if row.until > first or time.monotonic() > deadline:
                return False
            if self._closing.wait(0.5):
                return False

    # -- the lease -------------------------------------------------------------------------------------------

    def _take(self) -> None:
        """A new epoch, which fences all writes of this engine."""
        now = _now(self._engine)
        holder = f"{socket.gethostname()}, process {os.getpid()}"
        with self._engine.connect().execution_options(writes=True) as connection, connection.begin():
            mine = leases.c.name == SCHEDULER
            held = sa.update(leases).where(mine)
            values = {"epoch": leases.c.epoch + 1, "holder": holder, "since": now, "until": now + LEASE_S}
            if not connection.execute(held.values(values)).rowcount:
                values |= {"name": SCHEDULER, "epoch": 1}
                connection.execute(sa.insert(leases).values(values))
            self.epoch = int(connection.scalar(sa.select(leases.c.epoch).where(mine)) or 0)
        fence(self._engine, self.epoch)

    def _release(self) -> None:
        """Let the next one in at once."""
        mine = sa.and_(leases.c.name == SCHEDULER, leases.c.epoch == self.epoch)
        with suppress(SQLAlchemyError), self._engine.begin() as connection:
            connection.execute(sa.update(leases).where(mine).values(until=0.0))

    def _renew(self) -> None:
        """While this process lives: the lease, and the lock where the server has lost it."""
        while not self._closing.wait(RENEW_S):
            try:
                with self._engine.begin() as connection:
                    mine = sa.and_(leases.c.name == SCHEDULER, leases.c.epoch == self.epoch)
                    until = _now(self._engine) + LEASE_S
                    if not connection.execute(sa.update(leases).where(mine).values(until=until)).rowcount:
                        return  # another one has taken over; the next write says so
                if self._connection is None:
                    self._lock_again()
                else:
                    self._connection.scalar(sa.select(1))
                    self._connection.commit()
            except SQLAlchemyError as error:
                log.warning("the scheduler's lease is not renewed now: %s", reason(error))
                self._unlock()

    def _lock_again(self) -> None:
        if not self._lock():
            self._unlock()  # somebody looks whether this lease is renewed


def _now(engine: sa.Engine) -> sa.ColumnElement[float]:
    """The database's clock, s."""
    if engine.dialect.name == "sqlite":
        return sa.literal(time.time())
    return sa.cast(sa.func.extract("epoch", sa.func.clock_timestamp()), sa.Float)
