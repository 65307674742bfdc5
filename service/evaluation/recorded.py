"""`evaluate` with a record as its memory: one job, on local workers or an executor, and how far it is."""

from collections.abc import Callable
from concurrent.futures import Executor
from dataclasses import dataclass
from types import TracebackType
from typing import cast

import ce
from service.errors import InputError
from service.evaluation.batches import RecordedBatches
from service.evaluation.engine import ExecutorPool
from service.evaluation.evaluate import Observe, evaluate
from service.evaluation.job import Job, Problem, compiled
from service.evaluation.options import PATHS, options_of
from service.evaluation.path_job import evaluate_paths
from service.evaluation.path_store import PathSource
from service.evaluation.pool import LocalPool, OpenWorld
from service.evaluation.store import Chunk, ChunkSource
from service.evaluation.tolerance import Tolerance


@dataclass(frozen=True)
class Watcher:
    """Who is told how far a job is."""

    on_job: Callable[[Job, int], None] = lambda job, total: None  # the job begins; its rollouts at most
    on_chunk: Callable[[Chunk, bool], None] = lambda chunk, replayed: None
    on_record: Observe = lambda state, record: None


class LazyPool:
    """A pool of workers for a job that starts when first asked for: local ones, or those of an executor."""

    def __init__(
        self, job: Job, workers: int, open_world: OpenWorld = compiled, executor: Executor | None = None
    ):
        self._job, self._workers, self._open_world, self._executor = job, workers, open_world, executor
        self._pool: LocalPool | ExecutorPool | None = None

    def __call__(self) -> LocalPool | ExecutorPool:
        if self._pool is None:
            if self._executor is not None:
                self._pool = ExecutorPool(self._executor, self._job, self._open_world)
            else:
                self._pool = LocalPool(self._job, self._workers, self._open_world)
            self._pool.warm_up()
        return self._pool

    def __enter__(self) -> "LazyPool":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._pool is not None:
            self._pool.__exit__(kind, error, trace)


def evaluate_recorded(
    store: ChunkSource,
    job: Job,
    workers: int,
    watcher: Watcher,
    max_failed: float = 1.0,
    open_world: OpenWorld = compiled,
    executor: Executor | None = None,
) -> ce.Estimate:
    """Run one job to its end, from wherever its record in `store` stands.

    max_failed: TooManyFailures where a larger share of its rollouts fails
    open_world: what the rollouts run in
    executor: what runs them in place of local workers
    """
    if job.method == PATHS:
        if executor is not None:
            raise InputError(
                "method paths runs on local workers; leave out the executor, or give another method"
            )
        watcher.on_job(job, options_of(PATHS, job.options).budget)
        if not hasattr(store, "artefacts"):
            raise InputError("method paths keeps more than chunks of rollouts; give it a run directory")
        return evaluate_paths(
            cast(PathSource, store), job, workers, watcher.on_chunk, watcher.on_record, max_failed
        )
    problem = Problem(job)
    algorithm = problem.algorithm
    watcher.on_job(job, algorithm.total_rollouts)
    with LazyPool(job, workers, open_world, executor) as pool:
        tolerance = Tolerance(max_failed)
        run_batch = RecordedBatches(store, job, pool, watcher.on_chunk, tolerance)
        estimate = evaluate(algorithm, problem.stream_seed, run_batch, watcher.on_record)
        tolerance.end()
        return estimate
