"""A run directory: the jobs of a run and the append-only record of their finished chunks.

    RUN/run.json          the jobs as they were asked for
    RUN/rollouts.sqlite   a row for each finished chunk of rollouts; never changed once written

A chunk is rows [start, stop) of the batch (job, phase, iteration). A job's state is not stored: replaying the
recorded chunks through `service.evaluation.evaluate` gives it back to the bit, so a run that was killed at any moment
goes on from its last finished chunk.
"""

import logging
import os
from collections.abc import Iterable, Iterator
from functools import cache
from pathlib import Path

import msgspec
import sqlalchemy as sa

from service.closing import Closing
from service.errors import StoreError
from service.evaluation.differences import first_difference
from service.evaluation.job import Job
from service.evaluation.software import software
from service.evaluation.store.artefacts import ArtefactRecord
from service.evaluation.store.beginnings import Beginnings, beginning_row
from service.evaluation.store.chunk import HERE, Chunk
from service.evaluation.store.database import open_engine, sqlite_url, writing
from service.evaluation.store.records import ChunkRecord
from service.evaluation.store.tables import beginnings

FORMAT = 1
RECORD = "rollouts.sqlite"

log = logging.getLogger("tailroad.store")


class _Run(msgspec.Struct, frozen=True):
    format: int
    jobs: tuple[Job, ...]


class RunDirectory(Closing):
    """An open run directory; one process at a time writes to it."""

    def __init__(self, path: Path, jobs: tuple[Job, ...], new: bool = False):
        """Open the record of these jobs; with `new` one is made, else StoreError where it is missing or empty."""
        self.path = path
        self.jobs = jobs
        try:
            if not new:
                _refuse_without_record(path / RECORD)
            self._engine = open_engine(sqlite_url(path / RECORD), new=new)
        except StoreError as error:
            raise StoreError(f"{error}; check the folder, or start a new run with another --out") from error
        self._record = ChunkRecord(self._engine)
        self._beginnings = Beginnings(self._engine)
        self._artefacts = ArtefactRecord(self._engine)

    @classmethod
    def create(cls, path: Path, jobs: tuple[Job, ...]) -> "RunDirectory":
        """A new run directory; StoreError if there is a run already or the folder cannot be made."""
        if (path / "run.json").exists():
            raise StoreError(
                f"{path} holds a run already; continue it with --resume {path}, or give another --out"
            )
        try:
            path.mkdir(parents=True, exist_ok=True)
            found = cls(
                path, jobs, new=True
            )  # first the record: a run.json without one is a run that lost it
            if next(found.record.jobs(), None) is not None:
                found.close()
                raise StoreError(
                    f"{path / RECORD} holds rollouts, and the run.json that says of what is not there; take it from a "
                    "copy, or give another --out"
                )
            found._begin()
            part = path / "run.json.part"
            part.write_bytes(msgspec.json.format(msgspec.json.encode(_Run(FORMAT, jobs)), indent=2) + b"\n")
            part.replace(path / "run.json")
        except OSError as error:
            raise StoreError(f"cannot write to {path}: {error.strerror or error}") from error
        return found

    @classmethod
    def open_or_create(cls, path: Path, jobs: tuple[Job, ...]) -> "RunDirectory":
        """The run directory of these jobs, new or from before, to go on with; StoreError where it belongs to other jobs
        or was begun with other software."""
        if not (path / "run.json").exists():
            return cls.create(path, jobs)
        store = cls.open(path, to_go_on=True)
        other = _other_question(store.jobs, jobs)
        if other:
            store.close()
            raise StoreError(
                f"{path} holds a run of another question, {other}; give another --out, or remove it"
            )
        return store

    @classmethod
    def open(cls, path: Path, to_go_on: bool = False, checked: bool = True) -> "RunDirectory":
        """An existing run directory; StoreError if it is not one, or is not as it was begun.

        to_go_on: for more rollouts, which takes the software it was begun with, and runs again what is missing;
        checked: False to look at one that is not as it must be (`wrong`)
        """
        try:
            run = msgspec.json.decode((path / "run.json").read_bytes(), type=_Run)
        except FileNotFoundError as error:
            raise StoreError(f"{path} is not a run directory (it has no run.json); check the path") from error
        except (OSError, msgspec.MsgspecError, ValueError, RecursionError) as error:
            raise StoreError(f"{path / 'run.json'} cannot be read: {error}") from error
        if run.format != FORMAT:
            raise StoreError(f"{path} has run format {run.format}; this tailroad reads format {FORMAT}")
        found = cls(path, run.jobs)
        try:
            if checked:
                found._check(to_go_on)
        except BaseException:
            found.close()
            raise
        if old := found.record.without_checksum():
            _tell_old(path, old)
        return found

    def wrong(self) -> list[str]:
        """What is not as it was begun, a sentence each."""
        return [*self._edited(), *self._lost()]

    def _check(self, to_go_on: bool) -> None:
        if edited := self._edited():
            raise StoreError(f"{edited[0]}; put it back, or start a new run with another --out")
        lost = self._lost()
        if lost and not to_go_on:
            raise StoreError(
                f"{lost[0]}; `tailroad estimate --resume {self.path}` runs them again, to the same bits, or take the "
                "file from a copy"
            )
        if not to_go_on:
            return
        for name, beginning in self._beginnings.all().items():
            if other := software().differs_from(beginning.software):
                raise StoreError(
                    f"job {name} in {self.path} was begun with other software, and more rollouts would not be of one "
                    f"kind: here is {other}; go on with what it was begun with, or start a new run with another --out"
                )
        for line in lost:
            log.warning("%s; they are run again", line)
        for job in self.record.missing():
            self.record.count_anew(job)

    def _begin(self) -> None:
        """Write down what the jobs are begun with."""
        with writing(self._engine) as connection:
            connection.execute(sa.delete(beginnings))  # of a run that was killed before it was described
            connection.execute(sa.insert(beginnings), [beginning_row(job.id, job) for job in self.jobs])

    def _edited(self) -> list[str]:
        begun = self._beginnings.all()
        if not begun:  # of before it was written down
            return []
        there = {job.id: job for job in self.jobs}
        if there.keys() != begun.keys():
            return [
                f"{self.path / 'run.json'} has jobs {_list(there)}, and the run was begun with {_list(begun)}"
            ]
        changes = ((name, begun[name].differs_from(job)) for name, job in there.items())
        return [
            f"{self.path / 'run.json'} says {other.path} = {other.now} of job {name}, and its rollouts are of "
            f"{other.path} = {other.then}"
            for name, other in changes
            if other is not None
        ]

    def _lost(self) -> list[str]:
        return [
            f"{self.path / RECORD} has lost {count} chunks of rollouts of job {name} that were once recorded"
            for name, count in self.record.missing().items()
        ]

    def close(self) -> None:
        self._engine.dispose()

    def job(self, job_id: str) -> Job:
        for job in self.jobs:
            if job.id == job_id:
                return job
        raise StoreError(
            f"{self.path} has no job {job_id!r}; it has {', '.join(job.id for job in self.jobs)}"
        )

    def append(self, job_id: str, phase: str, iteration: int, chunk: Chunk) -> None:
        """Record a finished chunk for good; a chunk that is there already is left as it is."""
        try:
            self._record.append([(job_id, phase, iteration, chunk, HERE)])
        except StoreError as error:
            raise StoreError(
                f"{error}; what was recorded is kept, continue with --resume {self.path}"
            ) from error

    def chunks(
        self, job_id: str, phase: str, iteration: int, start: int = 0, stop: int | None = None
    ) -> list[Chunk]:
        """The recorded chunks of a batch that hold any of rows [start, stop), by start; stop = None: to its end."""
        return [chunk for chunk, _ in self._record.chunks(job_id, phase, iteration, start, stop)]

    def other_draws(self, chunk: Chunk) -> None:
        """Refuse a recorded chunk that is not of the rows that the job draws now."""
        raise StoreError(
            f"the rollouts {chunk.start} to {chunk.stop} in {self.path} are of other random draws than its run.json "
            "asks for: seed, scenario, weights, options or software are not those the run was begun with; put them "
            "back, or start a new run with another --out"
        )

    @property
    def artefacts(self) -> ArtefactRecord:
        """What jobs keep beside their chunks."""
        return self._artefacts

    @property
    def record(self) -> ChunkRecord:
        """The chunks, with where each comes from."""
        return self._record

    def all_chunks(self, job_id: str) -> Iterator[tuple[str, int, Chunk]]:
        """Every recorded chunk of a job as (phase, iteration, chunk)."""
        return self._record.all_chunks(job_id)


def _other_question(then: tuple[Job, ...], now: tuple[Job, ...]) -> str:
    """Where two runs' questions differ, in a few words, "" for one question."""
    if len(then) != len(now):
        return f"of {len(then)} jobs, not {len(now)}"
    for one, other in zip(then, now, strict=True):
        if (found := first_difference(one, other)) is not None:
            return f"with {found.path} = {found.then} and not {found.now}"
    return ""


def _list(names: Iterable[str]) -> str:
    return ", ".join(sorted(names)) or "none"


def _refuse_without_record(file: Path) -> None:
    """StoreError where the file of the record is not there, or holds nothing."""
    if not file.exists():
        raise StoreError(f"{file} is missing: the rollouts of this run are gone; take the file from a copy")
    beside = Path(f"{file}-wal")  # what SQLite has not taken over into the file yet
    if file.stat().st_size == 0 and not (beside.exists() and os.path.getsize(beside)):
        raise StoreError(f"{file} is empty: the rollouts of this run are gone; take the file from a copy")


@cache
def _tell_old(path: Path, chunks: int) -> None:
    """Once a process."""
    log.warning(
        "%s: %d chunks of rollouts were recorded before there were checksums; they are read as they are",
        path,
        chunks,
    )
