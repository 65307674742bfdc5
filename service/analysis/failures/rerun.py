"""Run rollouts once more in worker processes: a rollout is a pure function, so what happened in it can be seen."""

from collections.abc import Callable, Collection, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import AbstractContextManager
from dataclasses import dataclass, replace
from types import TracebackType

import numpy as np

from service.analysis.failures.driving import Driving, driving_of
from service.analysis.failures.motion import Motion, motion_of
from service.analysis.trace import Trace, record
from service.errors import WorkerError
from service.evaluation.job import Job, Problem
from service.evaluation.pool import watch_parent
from service.evaluation.processes import context_for
from service.world.sim.rollout import Simulator

AT_ONCE = 8  # rollouts that a worker is given at once
Draw = tuple[np.ndarray, int]  # x (d,) and the noise seed
Open = Callable[[Job], AbstractContextManager["Rerunner"]]  # a rerunner of a job, for as long as it is needed


@dataclass(frozen=True)
class Rerun:
    """A rollout that was run once more.

    driven_m, time_s: how far and how long the ego drove; driving: how the others did; motion: None where the smallest
    value is to background traffic, or the rollout failed; trace: of those asked for. What is remembered of an earlier
    time has f, outcome, error and motion alone.
    """

    f: float
    outcome: str
    error: str | None
    driven_m: float = 0.0
    time_s: float = 0.0
    motion: Motion | None = None
    driving: Driving | None = None
    trace: Trace | None = None


class Rerunner:
    """Worker processes for one job, started when first needed; use as a context manager.

    SUMO allows one simulation a process, so rollouts never run in the caller's. One that ends its process is an error
    like any other.
    """

    def __init__(self, job: Job, workers: int = 1):
        self._job, self._workers = job, workers
        self._pool: ProcessPoolExecutor | None = None

    def __enter__(self) -> "Rerunner":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def run(
        self,
        drawn: Sequence[Draw],
        traced: Collection[int] = (),
        on_done: Callable[[int], None] = lambda count: None,
    ) -> list[Rerun]:
        """Run the rollouts again, in order; traced: which to return the traces of; on_done: told how many more."""
        found: dict[int, Rerun] = {}
        parts = [range(i, min(i + AT_ONCE, len(drawn))) for i in range(0, len(drawn), AT_ONCE)]
        suspects: list[int] = []
        running = {}
        for part in parts:
            future = self._started(len(parts)).submit(
                _run, [drawn[i] for i in part], [i in traced for i in part]
            )
            running[future] = part
        for future in as_completed(running):
            try:
                found |= dict(zip(running[future], future.result(), strict=True))
                on_done(len(running[future]))
            except BrokenProcessPool:
                suspects += running[future]
        if suspects:
            self.close()
        for i in sorted(suspects):  # each alone, so that one that ends its process takes no other with it
            found[i] = self._alone(drawn[i], i in traced)
            on_done(1)
        return [found[i] for i in range(len(drawn))]

    def _alone(self, draw: Draw, traced: bool) -> Rerun:
        try:
            return self._started(1).submit(_run, [draw], [traced]).result()[0]
        except BrokenProcessPool:
            self.close()
            return Rerun(np.nan, "error", "the process that ran it died")

    def _started(self, parts: int) -> ProcessPoolExecutor:
        if self._pool is None:
            self._pool = ProcessPoolExecutor(
                max(min(self._workers, parts), 1),
                context_for(self._job.ego),
                initializer=_open,
                initargs=(self._job,),
            )
            try:
                self._pool.submit(_ready).result()
            except BrokenProcessPool as error:
                self.close()
                raise WorkerError(
                    "a process to run rollouts again ended before the first; its own message is above, or run one with "
                    "`tailroad rollout` to see it"
                ) from error
        return self._pool

    def close(self) -> None:
        """End the processes; they are started again when they are needed again."""
        if self._pool is not None:
            self._pool.shutdown()
            self._pool = None


_problem: Problem | None = None
_simulator: Simulator | None = None  # of the worker process


def _open(job: Job) -> None:
    global _problem, _simulator
    watch_parent()
    _problem = Problem(job)
    _simulator = _problem.simulator()


def _ready() -> None:
    pass


def _run(drawn: Sequence[Draw], traced: Sequence[bool]) -> list[Rerun]:
    assert _problem is not None
    assert _simulator is not None
    found = [rerun(_problem, _simulator, x, noise_seed) for x, noise_seed in drawn]
    return [again if keep else replace(again, trace=None) for again, keep in zip(found, traced, strict=True)]


def rerun(problem: Problem, simulator: Simulator, x: np.ndarray, noise_seed: int) -> Rerun:
    """One rollout, looked at in this process."""
    trace = record(problem, simulator, x, noise_seed)
    result = trace.rollout
    if result.error is not None:
        return Rerun(result.f, result.outcome, result.error)
    station = trace.station_m[:, trace.ego]
    return Rerun(
        result.f,
        result.outcome,
        None,
        float(station[-1] - station[0]),
        float(trace.time_s[-1]),
        motion_of(trace, problem.job.scenario.safety.rays, problem.corridor),
        driving_of(trace),
        trace,
    )
