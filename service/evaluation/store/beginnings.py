"""What the jobs of a record were begun with: the question and the software, written down with the first of it.

A description beside the record can be edited; this one carries a checksum, and what differs is named by its field.
"""

from collections.abc import Iterator
from datetime import UTC, datetime
from typing import Any

import msgspec
import sqlalchemy as sa

from service.errors import StoreError
from service.evaluation.differences import Difference, first_difference
from service.evaluation.job import Job
from service.evaluation.software import Software, software
from service.evaluation.store.chunk import checksum_of, same_checksum
from service.evaluation.store.database import read_rows, shown
from service.evaluation.store.tables import beginnings


class Beginning(msgspec.Struct, frozen=True):
    """The job that was asked for, and the software that was there."""

    job: Job
    software: Software

    def differs_from(self, now: Job) -> Difference | None:
        """The first field of the job that is another one now."""
        return first_difference(self.job, now)


class Beginnings:
    """The table of beginnings; a job of before there were any has none."""

    def __init__(self, engine: sa.Engine):
        self._engine = engine

    def of(self, job: str) -> Beginning | None:
        """StoreError where it is damaged."""
        return next((found for _, found in self._read(beginnings.c.job == job)), None)

    def all(self) -> dict[str, Beginning]:
        """By job."""
        return dict(self._read(sa.true()))

    def _read(self, which: sa.ColumnElement[bool]) -> Iterator[tuple[str, Beginning]]:
        for row in read_rows(self._engine, sa.select(beginnings).where(which)):
            try:
                found = Beginning(
                    msgspec.json.decode(row.spec, type=Job), msgspec.json.decode(row.software, type=Software)
                )
            except (msgspec.MsgspecError, ValueError, RecursionError):
                found = None
            if found is None or not same_checksum(row):
                raise StoreError(
                    f"{shown(self._engine)}: what job {row.job} was begun with is damaged; take it from a copy"
                )
            yield row.job, found


def beginning_row(name: str, job: Job) -> dict[str, Any]:
    """The job, begun now with the software that is here, as a row of the table."""
    row = {
        "job": name,
        "spec": msgspec.json.encode(job).decode(),
        "software": msgspec.json.encode(software()).decode(),
        "at": datetime.now(UTC).isoformat(timespec="milliseconds"),
    }
    return row | {"checksum": checksum_of(row)}
