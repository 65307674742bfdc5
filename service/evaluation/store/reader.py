"""A fleet's job read like a job of a run directory: what replays and reports take."""

from collections.abc import Generator, Iterator

from service.evaluation.job import Job
from service.evaluation.store.chunk import Chunk, Origin
from service.evaluation.store.jobs import JobRow, JobStore


class JobReader:
    """The record of one job; `job.id` stands for the job's own id in the database."""

    def __init__(self, store: JobStore, row: JobRow):
        self._store = store
        self._row = row
        self.jobs: tuple[Job, ...] = (row.job,)

    def chunks(
        self, job_id: str, phase: str, iteration: int, start: int = 0, stop: int | None = None
    ) -> list[Chunk]:
        """The chunks of a batch that hold any of rows [start, stop), by start; stop = None: to its end."""
        found = self._store.chunks.chunks(self._row.id, phase, iteration, start, stop)
        return [chunk for chunk, _ in found]

    def all_chunks(self, job_id: str) -> Iterator[tuple[str, int, Chunk]]:
        """Every chunk as (phase, iteration, chunk)."""
        return self._store.chunks.all_chunks(self._row.id)

    def from_chunk(
        self, key: tuple[str, int, int, int]
    ) -> Generator[tuple[str, int, Chunk, Origin], None, None]:
        """Every chunk from (phase, iteration, start, epoch) on as (phase, iteration, chunk, origin)."""
        return self._store.chunks.from_chunk(self._row.id, key)

    def other_draws(self, chunk: Chunk) -> None:
        """It is from before an earlier chunk was voided: the hub voids it when it opens the job."""

    def append(self, job_id: str, phase: str, iteration: int, chunk: Chunk) -> None:
        """A reader records nothing: what is here came from workers."""
        raise TypeError("the record of a fleet is written by its hub")
