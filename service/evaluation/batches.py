"""`run_batch` for local workers: answers from the record what was run before, runs the rest, and records it."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

import ce
from service.evaluation.engine import ExecutorPool
from service.evaluation.job import Job
from service.evaluation.pool import LocalPool, Work
from service.evaluation.store import Chunk, ChunkSource
from service.evaluation.store.draws import row_hashes, rows_digest
from service.evaluation.tolerance import Tolerance

CHUNK_S = 1.0  # simulated work of a chunk, in seconds of a worker that runs at TYPICAL_SPEED
TYPICAL_SPEED = 800.0  # simulated seconds a second
MAX_CHUNK = 250


class RecordedBatches:
    """Runs a job's batches on local workers, with the run directory as its memory.

    `on_chunk(chunk, replayed)` is told of every chunk, those from the record too.
    """

    def __init__(
        self,
        store: ChunkSource,
        job: Job,
        pool: Callable[[], LocalPool | ExecutorPool],
        on_chunk: Callable[[Chunk, bool], None] = lambda chunk, replayed: None,
        tolerance: Tolerance | None = None,
    ):
        self._store = store
        self._job = job
        self._pool = pool  # asked for when there is something to run, so that a replay starts no workers
        self._on_chunk = on_chunk
        self._tolerance = tolerance or Tolerance()
        rollout_s = job.scenario.time.horizon_s / TYPICAL_SPEED
        self._chunk = int(min(max(CHUNK_S / rollout_s, 1), MAX_CHUNK))

    def __call__(self, batch: ce.Batch) -> np.ndarray:
        """f of each row of the batch, (n,)."""
        offset = batch.start
        hashes = row_hashes(batch.x, batch.noise)

        def draws(chunk: Chunk) -> str:
            return rows_digest(hashes[chunk.start - offset : chunk.stop - offset])

        f = np.full(batch.stop - offset, np.nan)
        done = np.zeros(f.size, dtype=bool)
        recorded = self._store.chunks(self._job.id, batch.phase, batch.iteration, batch.start, batch.stop)
        for chunk in recorded:
            first, last = max(chunk.start, batch.start), min(chunk.stop, batch.stop)
            whole = (first, last) == (chunk.start, chunk.stop)
            if chunk.draws and whole and chunk.draws != draws(chunk):
                self._store.other_draws(chunk)
                continue
            f[first - offset : last - offset] = chunk.f[first - chunk.start : last - chunk.start]
            done[first - offset : last - offset] = True
            self._tolerance.see(chunk)
            self._on_chunk(chunk, True)
        work = [Work(offset + i, batch.x[i:j], batch.noise[i:j]) for i, j in _gaps(done, self._chunk)]
        if work:
            for chunk in self._pool().run(work):
                self._tolerance.see(chunk)
                with_draws = replace(chunk, draws=draws(chunk))
                self._store.append(self._job.id, batch.phase, batch.iteration, with_draws)
                f[chunk.start - offset : chunk.stop - offset] = chunk.f
                self._on_chunk(chunk, False)
        return f


def _gaps(done: np.ndarray, size: int) -> list[tuple[int, int]]:
    """Ranges of at most `size` rows that cover all rows not done."""
    ranges: list[tuple[int, int]] = []
    for row in np.flatnonzero(~done).tolist():
        if ranges and ranges[-1][1] == row and row - ranges[-1][0] < size:
            ranges[-1] = (ranges[-1][0], row + 1)
        else:
            ranges.append((row, row + 1))
    return ranges
