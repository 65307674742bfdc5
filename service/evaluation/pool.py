"""Local workers: processes that run chunks of rollouts, one SUMO each.

A worker process that dies (killed, out of memory, a crash in native code) does not end the run: its chunk is run
again alone, and if it dies again, row by row, so that the one rollout that kills its process becomes a recorded
error and all others get their value.
"""

import multiprocessing
import multiprocessing.connection
import os
import signal
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from service.errors import WorkerError
from service.evaluation.job import Job, Problem
from service.evaluation.processes import context_for
from service.evaluation.store import FAILED, Chunk
from service.world.sim.rollout import OUTCOMES, Rollout

OUTCOME_CODES = {name: code for code, name in enumerate(OUTCOMES.values())} | {"error": FAILED}
OUTCOME_NAMES = {code: name for name, code in OUTCOME_CODES.items()}


class RolloutWorld(Protocol):
    """What runs rollouts: `service.world.sim.rollout.Simulator`, or another that gives the same bits."""

    def run(self, x: np.ndarray, noise_seed: int) -> Rollout: ...


OpenWorld = Callable[[Job], RolloutWorld]  # called in each worker process; a function at a module's top level


def in_sumo(job: Job) -> RolloutWorld:
    """The world that a job's rollouts run in unless something else is asked for."""
    return Problem(job).simulator()


_world: RolloutWorld | None = None  # of this worker process


@dataclass(frozen=True)
class Work:
    """Rows [start, start + n) of a batch: x (n, d) and their noise seeds (n,)."""

    start: int
    x: np.ndarray
    noise_seeds: np.ndarray

    def row(self, index: int) -> "Work":
        return Work(self.start + index, self.x[index : index + 1], self.noise_seeds[index : index + 1])


def run_chunk(simulator: RolloutWorld, work: Work) -> Chunk:
    """Run a chunk's rollouts in this process."""
    began = time.perf_counter()
    rollouts = [simulator.run(x, int(seed)) for x, seed in zip(work.x, work.noise_seeds, strict=True)]
    return Chunk(
        work.start,
        work.start + len(rollouts),
        np.array([r.f for r in rollouts], dtype=np.float64),
        np.array([OUTCOME_CODES[r.outcome] for r in rollouts], dtype=np.uint8),
        np.array([r.steps for r in rollouts], dtype=np.int32),
        {i: r.error for i, r in enumerate(rollouts) if r.error is not None},
        time.perf_counter() - began,
    )


def watch_parent() -> None:
    """Let this process end when its parent does, however that ends: nobody would read what is run here. A process of a
    pool does not see it by itself."""
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    """Wait for the parent process to end, and end too."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        multiprocessing.connection.wait([parent.sentinel])
    os._exit(1)


def _open_worker(job: Job, open_world: OpenWorld) -> None:
    global _world
    watch_parent()
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is the parent's to handle
    _world = open_world(job)


def _work(work: Work) -> Chunk:
    assert _world is not None
    return run_chunk(_world, work)


def _ready() -> int:
    return os.getpid()


class LocalPool:
    """Worker processes for one job; use as a context manager."""

    def __init__(self, job: Job, workers: int, open_world: OpenWorld = in_sumo):
        self._job = job
        self._open_world = open_world
        self.workers = workers
        self._executor = self._start()

    def _start(self) -> ProcessPoolExecutor:
        return ProcessPoolExecutor(
            self.workers,
            mp_context=context_for(self._job.ego),
            initializer=_open_worker,
            initargs=(self._job, self._open_world),
        )

    def __enter__(self) -> "LocalPool":
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        self._executor.shutdown(wait=kind is None, cancel_futures=True)
        if kind is not None:
            _kill(self._executor)

    def warm_up(self) -> None:
        """Start the workers and let the first one compile the kernels for all."""
        try:
            self._executor.submit(_ready).result()
        except BrokenProcessPool as error:
            raise WorkerError(
                "a worker process ended before its first rollout; its own message is above, or run one rollout with "
                "`tailroad rollout` to see it"
            ) from error

    def pids(self) -> list[int]:
        """The worker processes there are now."""
        return list(self._executor._processes or {})

    def run(self, chunks: list[Work]) -> Iterator[Chunk]:
        """Run the chunks; each is yielded when it is done, in any order."""
        waiting = list(reversed(chunks))
        running: dict[Future[Chunk], Work] = {}
        while waiting or running:
            while waiting and len(running) < 2 * self.workers:
                try:
                    running[self._executor.submit(_work, waiting[-1])] = waiting[-1]
                except BrokenProcessPool:  # a worker died while nobody waited for it
                    if running:
                        break  # and what it held is found failed below
                    self._restart()
                else:
                    waiting.pop()
            done, _ = wait(running, return_when=FIRST_COMPLETED)
            suspects: list[Work] = []
            for future in done:
                work = running.pop(future)
                try:
                    yield future.result()
                except BrokenProcessPool:
                    suspects.append(work)
            if suspects:
                # the other futures of a broken pool fail too; all of them are run again, one at a time
                suspects += running.values()
                running.clear()
                self._restart()
                for work in suspects:
                    yield self._run_alone(work)

    def _restart(self) -> None:
        self._executor.shutdown(wait=False, cancel_futures=True)
        _kill(self._executor)
        self._executor = self._start()
        self.warm_up()  # where no worker can start, that is the error, not the rollouts

    def _run_alone(self, work: Work) -> Chunk:
        """Run a chunk while nothing else runs; where it kills its worker, row by row."""
        try:
            return self._executor.submit(_work, work).result()
        except BrokenProcessPool:
            self._restart()
        if len(work.noise_seeds) > 1:
            return _joined([self._run_alone(work.row(i)) for i in range(len(work.noise_seeds))])
        reason = "the worker process died during this rollout, each time it was tried"
        return Chunk(
            work.start,
            work.start + 1,
            np.array([np.nan]),
            np.array([FAILED], np.uint8),
            np.zeros(1, np.int32),
            {0: reason},
            0.0,
        )


def _joined(parts: list[Chunk]) -> Chunk:
    first = parts[0].start
    return Chunk(
        first,
        parts[-1].stop,
        np.concatenate([p.f for p in parts]),
        np.concatenate([p.outcomes for p in parts]),
        np.concatenate([p.steps for p in parts]),
        {p.start - first + i: error for p in parts for i, error in p.errors.items()},
        sum(p.worker_s for p in parts),
    )


def _kill(executor: ProcessPoolExecutor) -> None:
    for process in list((executor._processes or {}).values()):
        process.kill()
