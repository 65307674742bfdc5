"""A run directory: the jobs of a run and the append-only record of their finished chunks.

    RUN/run.json          the jobs as they were asked for
    RUN/rollouts.sqlite   a row for each finished chunk of rollouts; never changed once written

A chunk is rows [start, stop) of the batch (job, phase, iteration). A job's state is not stored: replaying the
recorded chunks through `service.evaluate` gives it back to the bit, so a run that was killed at any moment goes on
from its last finished chunk.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import msgspec
import numpy as np
import sqlalchemy as sa
from sqlalchemy.dialects import sqlite

from service.errors import StoreError
from service.job import Job

FORMAT = 1
FAILED = 255  # outcome code of a rollout that ended in an error

_metadata = sa.MetaData()
_chunks = sa.Table(
    "chunks",
    _metadata,
    sa.Column("job", sa.Text, primary_key=True),
    sa.Column("phase", sa.Text, primary_key=True),
    sa.Column("iteration", sa.Integer, primary_key=True),
    sa.Column("start", sa.Integer, primary_key=True),
    sa.Column("stop", sa.Integer, nullable=False),
    sa.Column("f", sa.LargeBinary, nullable=False),  # float64 little-endian, NaN = failed
    sa.Column("outcomes", sa.LargeBinary, nullable=False),  # uint8: service.pool.OUTCOME_CODES
    sa.Column("steps", sa.LargeBinary, nullable=False),  # int32 little-endian
    sa.Column("errors", sa.Text, nullable=False),  # JSON: {"row": "reason"}, rows counted from `start`
    sa.Column("worker_s", sa.Float, nullable=False),  # what it took a worker
)


@dataclass(frozen=True)
class Chunk:
    """The finished rollouts of rows [start, stop) of a batch."""

    start: int
    stop: int
    f: np.ndarray  # (n,) float64, NaN = failed
    outcomes: np.ndarray  # (n,) uint8
    steps: np.ndarray  # (n,) int32
    errors: dict[int, str]  # by row, counted from `start`
    worker_s: float


class _Run(msgspec.Struct, frozen=True):
    format: int
    jobs: tuple[Job, ...]


class RunDirectory:
    """An open run directory; one process at a time writes to it."""

    def __init__(self, path: Path, jobs: tuple[Job, ...]):
        self.path = path
        self.jobs = jobs
        self._engine = sa.create_engine(f"sqlite:///{path / 'rollouts.sqlite'}")
        sa.event.listen(self._engine, "connect", _configure)
        try:
            _metadata.create_all(self._engine)
        except sa.exc.SQLAlchemyError as error:
            raise StoreError(
                f"cannot open {path / 'rollouts.sqlite'}: {error.__cause__ or error}; check the folder, or start a new "
                "run with another --out"
            ) from error

    @classmethod
    def create(cls, path: Path, jobs: tuple[Job, ...]) -> "RunDirectory":
        """A new run directory; StoreError if there is a run already or the folder cannot be made."""
        if (path / "run.json").exists():
            raise StoreError(
                f"{path} holds a run already; continue it with --resume {path}, or give another --out"
            )
        try:
            path.mkdir(parents=True, exist_ok=True)
            (path / "run.json").write_bytes(
                msgspec.json.format(msgspec.json.encode(_Run(FORMAT, jobs)), indent=2) + b"\n"
            )
        except OSError as error:
            raise StoreError(f"cannot write to {path}: {error.strerror or error}") from error
        return cls(path, jobs)

    @classmethod
    def open(cls, path: Path) -> "RunDirectory":
        """An existing run directory; StoreError if it is not one."""
        try:
            run = msgspec.json.decode((path / "run.json").read_bytes(), type=_Run)
        except FileNotFoundError as error:
            raise StoreError(f"{path} is not a run directory (it has no run.json); check the path") from error
        except (OSError, msgspec.MsgspecError) as error:
            raise StoreError(f"{path / 'run.json'} cannot be read: {error}") from error
        if run.format != FORMAT:
            raise StoreError(f"{path} has run format {run.format}; this tailroad reads format {FORMAT}")
        return cls(path, run.jobs)

    def close(self) -> None:
        self._engine.dispose()

    def __enter__(self) -> "RunDirectory":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def job(self, job_id: str) -> Job:
        for job in self.jobs:
            if job.id == job_id:
                return job
        raise StoreError(
            f"{self.path} has no job {job_id!r}; it has {', '.join(job.id for job in self.jobs)}"
        )

    def append(self, job_id: str, phase: str, iteration: int, chunk: Chunk) -> None:
        """Record a finished chunk for good; a chunk that is there already is left as it is."""
        row = {
            "job": job_id,
            "phase": phase,
            "iteration": iteration,
            "start": chunk.start,
            "stop": chunk.stop,
            "f": chunk.f.astype("<f8").tobytes(),
            "outcomes": chunk.outcomes.astype(np.uint8).tobytes(),
            "steps": chunk.steps.astype("<i4").tobytes(),
            "errors": msgspec.json.encode({str(k): v for k, v in chunk.errors.items()}).decode(),
            "worker_s": chunk.worker_s,
        }
        statement = sqlite.insert(_chunks).on_conflict_do_nothing()
        try:
            with self._engine.begin() as connection:
                connection.execute(statement, row)
        except sa.exc.SQLAlchemyError as error:
            raise StoreError(
                f"cannot record rollouts in {self.path}: {error.__cause__ or error}; "
                f"what was recorded is kept, continue with --resume {self.path}"
            ) from error

    def chunks(
        self, job_id: str, phase: str, iteration: int, start: int = 0, stop: int | None = None
    ) -> list[Chunk]:
        """The recorded chunks of a batch that hold any of rows [start, stop), by start; stop = None: to its end."""
        query = (
            sa.select(_chunks)
            .where(_chunks.c.job == job_id, _chunks.c.phase == phase, _chunks.c.iteration == iteration)
            .where(_chunks.c.stop > start, sa.true() if stop is None else _chunks.c.start < stop)
            .order_by(_chunks.c.start)
        )
        return [chunk for _, _, chunk in self._read(query)]

    def all_chunks(self, job_id: str) -> Iterator[tuple[str, int, Chunk]]:
        """Every recorded chunk of a job as (phase, iteration, chunk)."""
        query = (
            sa.select(_chunks)
            .where(_chunks.c.job == job_id)
            .order_by(_chunks.c.phase, _chunks.c.iteration, _chunks.c.start)
        )
        yield from self._read(query)

    def _read(self, query: sa.Select) -> Iterator[tuple[str, int, Chunk]]:
        try:
            with self._engine.connect() as connection:
                for row in connection.execute(query):
                    errors = msgspec.json.decode(row.errors, type=dict[str, str])
                    yield (
                        row.phase,
                        row.iteration,
                        Chunk(
                            row.start,
                            row.stop,
                            np.frombuffer(row.f, "<f8"),
                            np.frombuffer(row.outcomes, np.uint8),
                            np.frombuffer(row.steps, "<i4"),
                            {int(k): v for k, v in errors.items()},
                            row.worker_s,
                        ),
                    )
        except sa.exc.SQLAlchemyError as error:
            raise StoreError(
                f"cannot read {self.path / 'rollouts.sqlite'}: {error.__cause__ or error}"
            ) from error


def _configure(connection, _record) -> None:
    """Readers do not wait for the writer, and a finished chunk survives a kill of the process."""
    cursor = connection.cursor()
    cursor.execute("PRAGMA journal_mode=WAL")
    cursor.execute("PRAGMA synchronous=NORMAL")
    cursor.close()
