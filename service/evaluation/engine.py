"""Runs chunks on any `concurrent.futures.Executor`: a process pool, Dask, loky, MPI, or an adapter to a batch system.

    ProcessPoolExecutor(8)                                  of the standard library
    distributed.Client(...).get_executor()                  Dask, with one thread a worker
    loky.get_reusable_executor(8)
    mpi4py.futures.MPIPoolExecutor(8)

A chunk's rollouts are the same wherever they run, so a run on an executor has the bits of a run in local processes. One
SUMO lives in a process: workers that are threads, of this process or beside each other, are refused. How work travels
is the executor's own affair (most pickle it), so it is for machines that trust each other; `tailroad worker` is for
others.
"""

import os
import threading
from collections.abc import Iterator
from concurrent.futures import (
    FIRST_COMPLETED,
    BrokenExecutor,
    CancelledError,
    Executor,
    Future,
    ThreadPoolExecutor,
    wait,
)

import msgspec
import numpy as np

from service.errors import InputError, WorkerError
from service.evaluation.job import Job, compiled
from service.evaluation.pool import OpenWorld, RolloutWorld, Work, run_chunk
from service.evaluation.store import Chunk
from service.world.egos.here import HERE
from service.world.egos.settings import EgoSettings

IN_FLIGHT = 256  # chunks that an executor is given at once
THREADS = (
    "one SUMO lives in a process, so every worker needs a process of its own: give a ProcessPoolExecutor, or of Dask "
    "Client(processes=True, threads_per_worker=1).get_executor()"
)


class ExecutorPool:
    """An executor that runs one job's chunks; it stays open, as it is the caller's. Use as a context manager."""

    def __init__(self, executor: Executor, job: Job, open_world: OpenWorld = compiled):
        if isinstance(executor, ThreadPoolExecutor):
            raise InputError(f"executor {type(executor).__name__}: its workers are threads; {THREADS}")
        if job.ego.startswith(HERE):
            raise InputError(
                f"ego {job.ego!r} lives in this process, and an executor's workers have it not: give a class that they "
                "can import, or leave out the executor"
            )
        self._executor = executor
        self._open_world = open_world
        self._job = msgspec.json.encode(job)
        self._environment = EgoSettings.from_environment().as_environment()
        self._running: dict[Future, Work] = {}

    def __enter__(self) -> "ExecutorPool":
        return self

    def __exit__(self, *_: object) -> None:
        for future in self._running:
            future.cancel()
        self._running.clear()

    def warm_up(self) -> None:
        """Meet a worker; InputError where it is this very process."""
        with self._told():
            found = self._executor.submit(os.getpid).result()
        if found == os.getpid():
            raise InputError(
                f"executor {type(self._executor).__name__}: its workers are threads of this process; {THREADS}"
            )

    def run(self, chunks: list[Work]) -> Iterator[Chunk]:
        """Run the chunks; each is yielded when it is done, in any order."""
        waiting = list(reversed(chunks))
        with self._told():
            while waiting or self._running:
                while waiting and len(self._running) < IN_FLIGHT:
                    work = waiting.pop()
                    self._running[self._submitted(work)] = work
                done, _ = wait(self._running, return_when=FIRST_COMPLETED)
                for future in done:
                    del self._running[future]
                    yield future.result()

    def _submitted(self, work: Work) -> Future:
        return self._executor.submit(
            run_elsewhere,
            self._job,
            self._environment,
            self._open_world,
            work.start,
            work.x,
            work.noise_seeds,
        )

    def _told(self) -> "_Told":
        return _Told(type(self._executor).__name__)


class _Told:
    """Turns what an executor raises when its workers are gone into one of our errors."""

    def __init__(self, executor: str):
        self._executor = executor

    def __enter__(self) -> None:
        pass

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: object) -> None:
        if isinstance(error, BrokenExecutor | CancelledError) or (kind and kind.__name__ == "KilledWorker"):
            raise WorkerError(
                f"executor {self._executor}: its workers ended before their work did ({type(error).__name__}: {error}"
                "); what was run before is kept, and the run goes on with a new executor"
            ) from error


_world: RolloutWorld | None = None  # of this worker process
_of: tuple[bytes, OpenWorld] | None = None  # what it was opened for
_thread: threading.Thread | None = None  # that SUMO runs in
_turn = threading.Lock()


def run_elsewhere(
    job: bytes,
    environment: dict[str, str],
    open_world: OpenWorld,
    start: int,
    x: np.ndarray,
    noise_seeds: np.ndarray,
) -> Chunk:
    """Run a chunk's rollouts in a worker of an executor; the world of a job stays open for the next chunk."""
    global _world, _of, _thread
    with _turn:
        here = threading.current_thread()
        if _thread is not None and _thread is not here and _thread.is_alive():
            raise WorkerError(f"two threads of one worker process were given rollouts; {THREADS}")
        _thread = here
        if _world is None or _of != (job, open_world):
            if _world is not None and (close := getattr(_world, "close", None)) is not None:
                close()
            os.environ.update(environment)
            _world = open_world(msgspec.json.decode(job, type=Job))
            _of = job, open_world
        return run_chunk(_world, Work(start, x, noise_seeds))
