"""The audit log: who told the service to do what, and what it refused. Rows are added, each with a hash of all before.

Whoever changes or takes out a row, or puts one between, breaks the chain from there on. That the last rows are there is
what a hash that was noted elsewhere tells (`tailroad log --head`).
"""

import hashlib
import threading
from collections.abc import Iterator
from datetime import UTC, datetime
from typing import Any

import msgspec
import sqlalchemy as sa
from sqlalchemy.exc import SQLAlchemyError

from service.errors import StoreError
from service.evaluation.store.database import read_rows, reason, shown, writing
from service.evaluation.store.tables import audit_log

PAGE = 1000  # rows read at once


class Entry(msgspec.Struct, frozen=True):
    """A line of the log.

    at: ISO 8601, UTC
    who: by what the connection shows, and not by a name of one's own choosing
    did: "submit", "cancel", "pause", "resume"
    job: that it was about, "" where none came of it
    refused: why it was not done, "" where it was
    hash: of this line and, by the one before it, of all before
    """

    number: int
    at: str
    who: str
    did: str
    job: str
    refused: str
    hash: str


class AuditLog:
    """The table of the log."""

    def __init__(self, engine: sa.Engine):
        self._engine = engine
        self._lock = threading.Lock()

    def add(self, who: str, did: str, job: str, refused: str = "") -> Entry:
        """Write a line; StoreError where that cannot be."""
        at = datetime.now(UTC).isoformat(timespec="milliseconds")
        try:
            with self._lock, writing(self._engine) as connection:
                last = connection.execute(
                    sa.select(audit_log).order_by(audit_log.c.number.desc()).limit(1)
                ).first()
                number, before = (1, "") if last is None else (last.number + 1, last.hash)
                said = {"number": number, "at": at, "who": who, "did": did, "job": job, "refused": refused}
                row = said | {"hash": _hash(before, said)}
                connection.execute(sa.insert(audit_log), row)
        except SQLAlchemyError as error:
            raise StoreError(
                f"cannot write to the audit log of {shown(self._engine)}: {reason(error)}"
            ) from error
        return msgspec.convert(row, Entry)

    def submitted_by(self, who: str) -> set[str]:
        """The jobs that somebody submitted."""
        query = sa.select(audit_log.c.job).where(audit_log.c.who == who, audit_log.c.did == "submit")
        return {row.job for row in read_rows(self._engine, query)}

    def entries(self, after: int = 0) -> Iterator[Entry]:
        """The lines after number `after`, in order."""
        while True:
            query = sa.select(audit_log).where(audit_log.c.number > after).order_by(audit_log.c.number)
            page = read_rows(self._engine, query.limit(PAGE))
            for row in page:
                yield Entry(**row._asdict())
                after = row.number
            if len(page) < PAGE:
                return

    def wrong(self, head: str = "") -> list[str]:
        """What is wrong with the chain, a sentence each. head: a hash that was noted, which must be that of a line."""
        found, number, before, seen = [], 0, "", not head
        for entry in self.entries():
            said = msgspec.structs.asdict(entry)
            stated = said.pop("hash")
            if entry.number != number + 1:
                found.append(
                    f"the audit log goes from line {number} to line {entry.number}: what was between is lost"
                )
            elif _hash(before, said) != stated:
                found.append(
                    f"line {entry.number} of the audit log, or one before it, is not as it was written"
                )
            number, before, seen = entry.number, stated, seen or stated == head
        if not seen:
            found.append(
                f"the audit log has no line with the hash {head}: it has lost its end, or was written anew"
            )
        return found


def _hash(before: str, said: dict[str, Any]) -> str:
    return hashlib.blake2b(msgspec.json.encode([before, *said.values()]), digest_size=16).hexdigest()
