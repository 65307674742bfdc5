"""A job's batch step: the algorithm's state, the batch it proposes and what is known of that batch's f.

This is `service.evaluation.evaluate` cut at the point where it waits for rollouts: `open_step` replays the record as
far as it goes, `next_step` takes in an answered batch.
"""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

import ce
from service.errors import StoreError
from service.evaluation.failed_share import SHOWN
from service.evaluation.store import Chunk, Origin
from service.evaluation.store.draws import row_hashes, rows_digest

ReadChunks = Callable[[str, int, int, int], list[tuple[Chunk, Origin]]]  # of (phase, iteration, start, stop)
ChunkName = tuple[str, int, int, int]  # phase, iteration, start, epoch
IterationRecord = ce.TrainingRecord | ce.EstimationRecord


@dataclass(frozen=True)
class BatchStep:
    """Where a job stands after some batches.

    number: of batches that are answered and taken in
    state: of the algorithm after them
    batch: that it proposes now; None: the algorithm has finished
    f: (n,) of the batch, as far as it is known
    done: (n,) where f is known
    hashes: (n,) of the batch's rows
    """

    number: int
    state: Any
    batch: ce.Batch | None
    f: np.ndarray = field(default_factory=lambda: np.zeros(0))
    done: np.ndarray = field(default_factory=lambda: np.zeros(0, dtype=bool))
    hashes: np.ndarray = field(default_factory=lambda: np.zeros(0, dtype=np.uint64))

    def digest(self, start: int, stop: int) -> str:
        """Of rows [start, stop) of the batch, counted as the batch counts them."""
        assert self.batch is not None
        return rows_digest(self.hashes[start - self.batch.start : stop - self.batch.start])


@dataclass(frozen=True)
class Replay:
    """Where the recorded chunks take a job.

    records: of the batches answered on the way
    rollouts: of theirs and the open batch's in the record
    stale: chunks of rows that the batches do not have
    failed: of the rollouts
    first_failures: what the first of them said
    """

    step: BatchStep
    records: tuple[IterationRecord, ...]
    rollouts: int
    stale: tuple[ChunkName, ...]
    failed: int = 0
    first_failures: tuple[str, ...] = ()


def failures_told(phase: str, iteration: int, chunk: Chunk) -> list[str]:
    """What each failed rollout of a chunk said, by its row."""
    return [
        f"rollout {chunk.start + row} ({phase} {iteration}): {reason}"
        for row, reason in sorted(chunk.errors.items())
    ]


def open_step(algorithm: ce.Algorithm, seed: int, epoch: int, read: ReadChunks) -> Replay:
    """The job from its beginning, as far as its record goes."""
    return _replayed(algorithm, _step_of(algorithm, 0, algorithm.init(seed)), epoch, read)


def next_step(algorithm: ce.Algorithm, step: BatchStep, epoch: int, read: ReadChunks) -> Replay:
    """From a step whose batch is answered in full, as far as the record goes."""
    after, record = _answered(algorithm, step)
    later = _replayed(algorithm, after, epoch, read)
    return replace(later, records=(record, *later.records))


def _replayed(algorithm: ce.Algorithm, step: BatchStep, epoch: int, read: ReadChunks) -> Replay:
    records: list[IterationRecord] = []
    stale: list[ChunkName] = []
    told: list[str] = []
    rollouts = failed = 0
    while step.batch is not None:
        step, others, wrong = _filled(step, epoch, read)
        stale += others
        told += wrong[: SHOWN - len(told)]
        rollouts += int(np.count_nonzero(step.done))
        failed += int(np.count_nonzero(np.isnan(step.f[step.done])))
        if not step.done.all():
            break
        step, record = _answered(algorithm, step)
        records.append(record)
    return Replay(step, tuple(records), rollouts, tuple(stale), failed, tuple(told))


def _answered(algorithm: ce.Algorithm, step: BatchStep) -> tuple[BatchStep, IterationRecord]:
    assert step.batch is not None
    state, record = algorithm.update(step.state, step.batch, step.f)
    return _step_of(algorithm, step.number + 1, state), record


def _step_of(algorithm: ce.Algorithm, number: int, state: Any) -> BatchStep:
    batch = algorithm.propose(state)
    if batch is None:
        return BatchStep(number, state, None)
    n = batch.stop - batch.start
    return BatchStep(
        number, state, batch, np.full(n, np.nan), np.zeros(n, bool), row_hashes(batch.x, batch.noise)
    )


def _filled(step: BatchStep, epoch: int, read: ReadChunks) -> tuple[BatchStep, list[ChunkName], list[str]]:
    """The step with what the record has of its batch, the chunks that are of other rows than the batch's, and what its
    failed rollouts said.

    Those are from before an earlier chunk was voided. In the present epoch there can be none: StoreError.
    """
    batch = step.batch
    assert batch is not None
    f, done = step.f.copy(), step.done.copy()
    stale: list[ChunkName] = []
    told: list[str] = []
    for chunk, origin in read(batch.phase, batch.iteration, batch.start, batch.stop):
        first, last = max(chunk.start, batch.start), min(chunk.stop, batch.stop)
        whole = (first, last) == (chunk.start, chunk.stop)
        if chunk.draws and not (whole and chunk.draws == step.digest(first, last)):
            if origin.epoch == epoch:
                raise StoreError(
                    f"recorded rollouts [{chunk.start}, {chunk.stop}) of {batch.phase} {batch.iteration} are of other "
                    "random draws than this job makes here; go on with the software the job was begun with"
                )
            if origin.epoch < epoch:  # those of a later epoch are of a replay after this one
                stale.append((batch.phase, batch.iteration, chunk.start, origin.epoch))
            continue
        f[first - batch.start : last - batch.start] = chunk.f[first - chunk.start : last - chunk.start]
        done[first - batch.start : last - batch.start] = True
        told += failures_told(batch.phase, batch.iteration, chunk)
    return replace(step, f=f, done=done), stale, told
