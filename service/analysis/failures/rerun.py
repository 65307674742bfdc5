"""Run rollouts once more in worker processes: a rollout is a pure function, so what happened in it can be seen."""

from collections.abc import Callable, Collection, Sequence
from contextlib import AbstractContextManager, ExitStack, nullcontext
from dataclasses import dataclass, replace
from types import TracebackType

import numpy as np

from service.analysis.failures.driving import Driving, driving_of
from service.analysis.failures.lapses import Lapse, lapse_of
from service.analysis.failures.motion import Motion, motion_of
from service.analysis.trace import Trace, record
from service.evaluation.job import Job, Problem
from service.evaluation.process_pool import DIED, NumberedParts, ProcessPool, of_lists
from service.evaluation.processes import context_for
from service.world.safety.contact import Contact
from service.world.scenario.noise import Noise
from service.world.sim.rollout import Simulator

AT_ONCE = 8  # rollouts that a worker is given at once
WORTH_A_PROCESS = 200  # rollouts that take longer than a second process takes to start
Draw = tuple[np.ndarray, Noise]  # x (d,) and its noise
Part = tuple[int, Draw, bool]  # number, draw, and whether its trace is wanted
Open = Callable[[Job], AbstractContextManager["Rerunner"]]  # a rerunner of a job, for as long as it is needed


@dataclass(frozen=True)
class Rerun:
    """A rollout that was run once more.

    driven_m, time_s: how far and how long the ego drove
    driving: how the others did
    motion: None where the smallest value is to background traffic, or the rollout failed
    contact: of the ego, where it ended the rollout
    trace: of those asked for
    lapse: of the other vehicle's driver, where drivers have any

    What is remembered of an earlier time has f, outcome, error, motion, contact and lapse alone.
    """

    f: float
    outcome: str
    error: str | None
    driven_m: float = 0.0
    time_s: float = 0.0
    motion: Motion | None = None
    driving: Driving | None = None
    trace: Trace | None = None
    contact: Contact | None = None
    lapse: Lapse | None = None


class Rerunner(NumberedParts[Part, Rerun]):
    """Worker processes for one job, started when first needed; use as a context manager.

    SUMO allows one simulation a process, so rollouts never run in the caller's. One that ends its process is an error
    like any other.
    """

    def __init__(self, job: Job, workers: int = 1):
        super().__init__(ProcessPool(workers, RERUNS, _open, (job,), lambda: context_for(job.ego)))

    def run(
        self,
        drawn: Sequence[Draw],
        traced: Collection[int] = (),
        on_done: Callable[[int], None] = lambda count: None,
    ) -> list[Rerun]:
        """Run the rollouts again, in order.

        traced: which to return the traces of
        on_done: told how many more
        """
        wanted = [(i, draw, i in traced) for i, draw in enumerate(drawn)]
        return self._in_order(wanted, AT_ONCE, on_done, one_by_one=len(wanted) < WORTH_A_PROCESS)


class Rerunners:
    """One rerunner for each job, kept for all that is asked of it within; use as a context manager.

    To start a process costs as much as hundreds of rollouts.
    """

    def __init__(self, workers: int = 1):
        self._workers = workers
        self._stack = ExitStack()
        self._kept: dict[str, Rerunner] = {}

    def __enter__(self) -> "Rerunners":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._kept.clear()
        self._stack.__exit__(kind, error, trace)

    def __call__(self, job: Job) -> AbstractContextManager[Rerunner]:
        """The rerunner of that job; to leave it does not end it."""
        if job.id not in self._kept:
            self._kept[job.id] = self._stack.enter_context(Rerunner(job, self._workers))
        return nullcontext(self._kept[job.id])


_problem: Problem | None = None
_simulator: Simulator | None = None  # of the worker process


def _open(job: Job) -> None:
    global _problem, _simulator
    _problem = Problem(job)
    _simulator = _problem.simulator()


def _run(part: list[Part]) -> list[Rerun]:
    assert _problem is not None
    assert _simulator is not None
    found = [rerun(_problem, _simulator, *draw) for _, draw, _ in part]
    return [
        again if traced else replace(again, trace=None)
        for again, (_, _, traced) in zip(found, part, strict=True)
    ]


RERUNS = of_lists(_run, lambda part: Rerun(np.nan, "error", DIED))


def rerun(problem: Problem, simulator: Simulator, x: np.ndarray, noise_seed: Noise) -> Rerun:
    """One rollout, looked at in this process."""
    trace = record(problem, simulator, x, noise_seed)
    result = trace.rollout
    if result.error is not None:
        return Rerun(result.f, result.outcome, result.error)
    station = trace.station_m[:, trace.ego]
    scenario = problem.job.scenario
    motion = motion_of(trace, scenario.safety.rays, problem.corridor)
    return Rerun(
        result.f,
        result.outcome,
        None,
        float(station[-1] - station[0]),
        float(trace.time_s[-1]),
        motion,
        driving_of(trace),
        trace,
        result.contact,
        lapse_of(trace, motion, scenario, x),
    )
