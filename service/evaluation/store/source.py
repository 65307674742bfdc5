"""What replays, reports and batches need of a record, be it a run directory's or a fleet's."""

from collections.abc import Iterator
from typing import Protocol

from service.evaluation.store.chunk import Chunk


class ChunkSource(Protocol):
    """The chunks of jobs, by the job's id."""

    def chunks(
        self, job_id: str, phase: str, iteration: int, start: int = 0, stop: int | None = None
    ) -> list[Chunk]:
        """The recorded chunks of a batch that hold any of rows [start, stop), by start; stop = None: to its end."""

    def all_chunks(self, job_id: str) -> Iterator[tuple[str, int, Chunk]]:
        """Every recorded chunk of a job as (phase, iteration, chunk)."""

    def other_draws(self, chunk: Chunk) -> None:
        """Told of a recorded chunk whose rows are not those that the job draws: StoreError, or it is left out."""

    def append(self, job_id: str, phase: str, iteration: int, chunk: Chunk) -> None:
        """Record a finished chunk for good; a chunk that is there already is left as it is."""
