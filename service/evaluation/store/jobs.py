"""The record of a fleet: its jobs, what they told, their chunks and iterations, audits and quarantined workers."""

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from datetime import UTC, datetime
from typing import Any

import msgspec
import sqlalchemy as sa
from sqlalchemy.exc import IntegrityError, SQLAlchemyError

import ce
from service.closing import Closing
from service.errors import StoreError
from service.evaluation.job import Job
from service.evaluation.store.beginnings import Beginnings, beginning_row
from service.evaluation.store.chunk import Chunk, Origin, checksum_of, same_checksum
from service.evaluation.store.claim import Claim
from service.evaluation.store.database import (
    LOCK_WAIT_S,
    check_sqlite_file,
    insert_once,
    open_engine,
    read_rows,
    reason,
    shown,
    writing,
)
from service.evaluation.store.decoding import decoded, status_of
from service.evaluation.store.log import AuditLog
from service.evaluation.store.notes import NOTE, Said, said_of
from service.evaluation.store.records import ChunkRecord
from service.evaluation.store.states import StateRecord
from service.evaluation.store.tables import (
    audits,
    beginnings,
    chunks,
    events,
    iterations,
    jobs,
    quarantine,
    voids,
)

OPEN = ("running", "paused")  # statuses of jobs that are not over
STATUSES = (*OPEN, "done", "cancelled", "failed", "needs-restart")
STATUS = "status"  # the kind of event whose last one is the job's status


def _last(kind: str) -> sa.Label[Any]:
    """The body of a job's last event of a kind."""
    query = sa.select(events.c.body).where(events.c.job == jobs.c.id, events.c.kind == kind)
    return query.order_by(events.c.number.desc()).limit(1).scalar_subquery().label(kind)


_STATUS = _last(STATUS)
_WITH_STATUS = sa.select(jobs, _STATUS, _last(NOTE))


class JobRow(msgspec.Struct, frozen=True):
    """A job as it was submitted, and its status."""

    id: str
    number: int
    job: Job
    priority: int
    weight: float
    label: str
    at: str
    status: str
    reason: str  # of the status, where there is one to tell
    max_failed: float = 1.0  # share of failed rollouts that is tolerated
    note: Said = Said()


class Event(msgspec.Struct, frozen=True):
    """Something that a job told."""

    job: str
    number: int
    kind: str
    body: dict[str, Any]
    at: str


class AuditRow(msgspec.Struct, frozen=True):
    """A chunk that `worker` ran too, to the same bits."""

    job: str
    phase: str
    iteration: int
    start: int
    epoch: int
    worker: str


class Mark(msgspec.Struct, frozen=True):
    """How a job's record is at a moment. Nothing in a record is changed or removed: equal marks are of equal records.

    epoch: how often chunks were voided
    chunks: ever recorded
    voided: of those
    """

    status: str
    epoch: int
    chunks: int
    voided: int

    @property
    def over(self) -> bool:
        """Whether nothing will be recorded any more, unless chunks are voided."""
        return self.status not in OPEN


class JobStore(Closing):
    """The database of a fleet; any number of readers, one scheduler that writes."""

    def __init__(self, url: str, lock_wait_s: float = LOCK_WAIT_S, new: bool = True):
        """Open the database; with `new` the tables of one that has none are made, which is else refused."""
        self._engine = open_engine(url, lock_wait_s, new)
        self.chunks = ChunkRecord(self._engine)
        self.states = StateRecord(self._engine)
        self.beginnings = Beginnings(self._engine)
        self.log = AuditLog(self._engine)

    def close(self) -> None:
        self._engine.dispose()

    def claim(self) -> Claim:
        """Make sure that no other scheduler works on this database; StoreError where one does."""
        return Claim(self._engine)

    def check(self) -> None:
        """StoreError where the database cannot be read now, or is not one any more."""
        if self._engine.dialect.name == "sqlite":
            check_sqlite_file(self._engine)
        for table in (jobs, events, chunks):
            self._read(sa.select(table).limit(1))

    # -- jobs and what they tell -----------------------------------------------------------------------------

    def add_job(
        self,
        job_id: str,
        job: Job,
        priority: int,
        weight: float,
        label: str,
        status: str,
        max_failed: float = 1.0,
    ) -> JobRow:
        """Record a new job with its first status; StoreError where there is one of that id."""
        now = _now()
        try:
            with self._write("record the job") as connection:
                number = 1 + (connection.scalar(sa.select(sa.func.max(jobs.c.number))) or 0)
                spec = msgspec.json.encode(job).decode()
                row = {"id": job_id, "number": number, "spec": spec, "priority": priority, "weight": weight,
                       "label": label, "at": now, "max_failed": max_failed}  # fmt: skip
                connection.execute(sa.insert(jobs), row)
                connection.execute(sa.insert(beginnings), beginning_row(job_id, job))
                _add_event(connection, job_id, STATUS, {"status": status, "reason": ""}, now)
        except IntegrityError as error:
            raise StoreError(f"there is a job {job_id!r} already") from error
        return JobRow(job_id, number, job, priority, weight, label, now, status, "", max_failed)

    def job(self, job_id: str) -> JobRow | None:
        return next(iter(self._jobs(_WITH_STATUS.where(jobs.c.id == job_id))), None)

    def jobs(self, after: int = 0, limit: int = 100) -> list[JobRow]:
        """Jobs in the order of submission, those after number `after`."""
        query = _WITH_STATUS.where(jobs.c.number > after).order_by(jobs.c.number).limit(limit)
        return list(self._jobs(query))

    def jobs_with(self, statuses: Iterable[str]) -> list[JobRow]:
        """All jobs that have one of these statuses. It looks at the status of every job there is, and reads those that
        have one of these."""
        wanted = set(statuses)
        every = self._read(sa.select(jobs.c.id, _STATUS).order_by(jobs.c.number))
        found = (
            self.job(row.id) for row in every if status_of(row.status, row.id, STATUSES).status in wanted
        )
        return [row for row in found if row is not None]

    def add_event(self, job_id: str, kind: str, body: dict[str, Any]) -> Event:
        """Record what a job tells; its number is one more than the job's last."""
        now = _now()
        with self._write("record an event") as connection:
            return Event(job_id, _add_event(connection, job_id, kind, body, now), kind, body, now)

    def events(self, job_id: str, after: int = 0, limit: int = 1000) -> list[Event]:
        """What the job told after event number `after`."""
        query = (
            sa.select(events)
            .where(events.c.job == job_id, events.c.number > after)
            .order_by(events.c.number)
            .limit(limit)
        )
        return self._events(query)

    def events_of(self, job_id: str, kind: str) -> list[Event]:
        """All that the job told of one kind, in order."""
        query = sa.select(events).where(events.c.job == job_id, events.c.kind == kind)
        return self._events(query.order_by(events.c.number))

    def _events(self, query: sa.Select) -> list[Event]:
        return [
            Event(
                row.job, row.number, row.kind, decoded(row.body, dict, f"an event of job {row.job}"), row.at
            )
            for row in self._read(query)
        ]

    def _jobs(self, query: sa.Select) -> Iterator[JobRow]:
        for row in self._read(query):
            status = status_of(row.status, row.id, STATUSES)
            job = decoded(row.spec, Job, f"the question of job {row.id}")
            yield JobRow(row.id, row.number, job, row.priority, row.weight, row.label, row.at,
                         status.status, status.reason, row.max_failed,
                         said_of(row.note, row.id))  # fmt: skip

    # -- chunks, iterations, audits --------------------------------------------------------------------------

    def append(self, finished: Iterable[tuple[str, str, int, Chunk, Origin]]) -> None:
        """Record chunks as (job, phase, iteration, chunk, origin), all or none."""
        self.chunks.append(finished)

    def epoch(self, job_id: str) -> int:
        """How often chunks of the job were voided."""
        (row,) = self._read(sa.select(sa.func.max(voids.c.next_epoch)).where(voids.c.job == job_id))
        return row[0] or 0

    def mark(self, job_id: str) -> Mark:
        """How the job's record is now, all of one moment."""
        of_job = [
            sa.select(kind).where(table.c.job == job_id).scalar_subquery()
            for kind, table in (
                (sa.func.max(voids.c.next_epoch), voids),
                (sa.func.count(), chunks),
                (sa.func.count(), voids),
            )
        ]
        found = self._read(sa.select(jobs.c.id, _STATUS, *of_job).where(jobs.c.id == job_id))
        if not found:
            raise StoreError(f"there is no job {job_id!r} in the database any more; take it from a copy")
        _, status, epoch, recorded, voided = found[0]
        return Mark(status_of(status, job_id, STATUSES).status, epoch or 0, recorded, voided)

    def cost(self, job_id: str) -> tuple[float, int, int]:
        """What the job's rollouts in the record have taken: worker seconds, simulated steps, how many SUMO drove."""
        worker_s, steps, in_sumo = 0.0, 0, 0
        for _, _, chunk in self.chunks.all_chunks(job_id):
            worker_s += chunk.worker_s
            steps += int(chunk.steps.sum())
            in_sumo += chunk.driven_in_sumo
        return worker_s, steps, in_sumo

    def add_iterations(
        self, job_id: str, epoch: int, first: int, records: list[ce.TrainingRecord | ce.EstimationRecord]
    ) -> None:
        """Record what iterations first, first + 1, ... of an epoch came to; those known are left as they are."""
        now = _now()
        rows = [
            {"job": job_id, "epoch": epoch, "number": first + i, "at": now,
             "record": msgspec.json.encode(record).decode()}
            for i, record in enumerate(records)
        ]  # fmt: skip
        rows = [row | {"checksum": checksum_of(row)} for row in rows]
        if rows:
            with self._write("record iterations") as connection:
                connection.execute(insert_once(self._engine, iterations), rows)

    def iterations(self, job_id: str, after: int = -1, limit: int = 1000) -> list[dict[str, Any]]:
        """The records of the job's present epoch, in order, those after number `after`."""
        query = (
            sa.select(iterations)
            .where(iterations.c.job == job_id, iterations.c.epoch == self.epoch(job_id))
            .where(iterations.c.number > after)
            .order_by(iterations.c.number)
            .limit(limit)
        )
        found = self._read(query)
        for row in found:
            if not same_checksum(row):
                raise StoreError(
                    f"the record of what batch {row.number} of job {job_id} came to is damaged; `tailroad verify` says "
                    "what else is and what can be saved"
                )
        return [{"number": row.number, **msgspec.json.decode(row.record)} for row in found]

    def batches(self, job_id: str, epoch: int) -> int:
        """How many batches of an epoch are known to be complete."""
        query = sa.select(sa.func.max(iterations.c.number)).where(
            iterations.c.job == job_id, iterations.c.epoch == epoch
        )
        (row,) = self._read(query)
        return 0 if row[0] is None else row[0] + 1

    def add_audits(self, agreed: Iterable[AuditRow]) -> None:
        """Record chunks that a second worker ran to the same bits."""
        now = _now()
        rows = [msgspec.structs.asdict(one) | {"at": now} for one in agreed]
        with self._write("record audits") as connection:
            connection.execute(insert_once(self._engine, audits), rows)

    # -- workers that were wrong -----------------------------------------------------------------------------

    def quarantine(self, worker: str, why: str, also: Iterable[str] = ()) -> list[str]:
        """Void every chunk of the worker that no other worker has confirmed, and keep its name; the jobs concerned.

        also: what is refused with it, as "host 192.0.2.7"

        Those that were done are running again, by the same transaction: no job is done without its rollouts.
        """
        now = _now()
        key = ("job", "phase", "iteration", "start", "epoch")
        confirmed = sa.exists().where(*(chunks.c[k] == audits.c[k] for k in key))
        voided = sa.exists().where(*(chunks.c[k] == voids.c[k] for k in key))
        doubtful = sa.and_(chunks.c.worker == worker, ~confirmed, ~voided)
        with self._write("quarantine a worker") as connection:
            found = connection.scalars(sa.select(chunks.c.job).where(doubtful).distinct()).all()
            for job_id in found:
                last = connection.scalar(
                    sa.select(sa.func.max(voids.c.next_epoch)).where(voids.c.job == job_id)
                )
                next_epoch = sa.literal((last or 0) + 1)
                picked = sa.select(*(chunks.c[k] for k in key), next_epoch, sa.literal(why), sa.literal(now))
                connection.execute(
                    sa.insert(voids).from_select(
                        [*key, "next_epoch", "reason", "at"], picked.where(doubtful, chunks.c.job == job_id)
                    )
                )
                status = connection.scalar(sa.select(_STATUS).where(jobs.c.id == job_id))
                if status is not None and msgspec.json.decode(status)["status"] == "done":
                    body = {"status": "running", "reason": taken_up_again(worker)}
                    _add_event(connection, job_id, STATUS, body, now)
            rows = [{"worker": name, "reason": why, "at": now} for name in (worker, *also)]
            connection.execute(insert_once(self._engine, quarantine), rows)
            # once more where the database has done it before and its answer was lost: the same jobs
            void = sa.and_(*(chunks.c[k] == voids.c[k] for k in key), chunks.c.worker == worker)
            concerned = connection.scalars(sa.select(voids.c.job).join(chunks, void).distinct()).all()
        return sorted(concerned)

    def void(
        self, job_id: str, names: Iterable[tuple[str, int, int, int]], next_epoch: int, why: str
    ) -> None:
        """Void chunks, named by phase, iteration, start and epoch."""
        now = _now()
        rows = [
            {"job": job_id, "phase": phase, "iteration": iteration, "start": start, "epoch": epoch,
             "next_epoch": next_epoch, "reason": why, "at": now}
            for phase, iteration, start, epoch in names
        ]  # fmt: skip
        with self._write("void rollouts") as connection:
            connection.execute(insert_once(self._engine, voids), rows)

    def quarantined(self) -> dict[str, str]:
        """The workers that were found wrong, and what each had done."""
        return {row.worker: row.reason for row in self._read(sa.select(quarantine))}

    # -- access ----------------------------------------------------------------------------------------------

    @contextmanager
    def _write(self, what: str) -> Iterator[sa.Connection]:
        try:
            with writing(self._engine) as connection:
                yield connection
        except IntegrityError:
            raise
        except SQLAlchemyError as error:
            raise StoreError(f"cannot {what} in {shown(self._engine)}: {reason(error)}") from error

    def _read(self, query: sa.Select) -> list[sa.Row]:
        return read_rows(self._engine, query)


def taken_up_again(worker: str) -> str:
    """The reason of the status of a job that was done with rollouts of a worker found wrong since."""
    return f"taken up again: rollouts of worker {worker} are void"


def _add_event(connection: sa.Connection, job_id: str, kind: str, body: dict[str, Any], now: str) -> int:
    number = 1 + (
        connection.scalar(sa.select(sa.func.max(events.c.number)).where(events.c.job == job_id)) or 0
    )
    row = {
        "job": job_id,
        "number": number,
        "kind": kind,
        "body": msgspec.json.encode(body).decode(),
        "at": now,
    }
    connection.execute(sa.insert(events), row)
    return number


def _now() -> str:
    return datetime.now(UTC).isoformat(timespec="milliseconds")
