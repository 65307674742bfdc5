"""Run rollouts once more in worker processes: a rollout is a pure function, so what happened in it can be seen."""

import multiprocessing
from collections.abc import Callable, Collection, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass, replace

import numpy as np

from service.failures.motion import Motion, motion_of
from service.job import Job, Problem
from service.sim.rollout import Simulator
from service.trace import Trace, record

AT_ONCE = 8  # rollouts that a worker is given at once


@dataclass(frozen=True)
class Again:
    """A rollout that was run once more.

    motion: None where the smallest value is to background traffic, or the rollout failed; trace: of those asked for.
    """

    f: float
    outcome: str
    error: str | None
    motion: Motion | None
    trace: Trace | None


def rerun(
    job: Job,
    drawn: Sequence[tuple[np.ndarray, int]],
    workers: int = 1,
    traced: Collection[int] = (),
    on_done: Callable[[int], None] = lambda count: None,
) -> list[Again]:
    """Run the rollouts of (x (d,), noise seed) again, in order; `traced`: which to return the traces of.

    A rollout that ends its process is an error like any other. SUMO allows one simulation a process, so this never
    runs in the caller's.
    """
    if not drawn:
        return []
    found: dict[int, Again] = {}
    keep = frozenset(traced)
    parts = [range(i, min(i + AT_ONCE, len(drawn))) for i in range(0, len(drawn), AT_ONCE)]
    suspects: list[range] = []
    with _pool(job, min(workers, len(parts))) as pool:
        running = {
            pool.submit(_run, [drawn[i] for i in part], [i in keep for i in part]): part for part in parts
        }
        for future in as_completed(running):
            part = running[future]
            try:
                found |= dict(zip(part, future.result(), strict=True))
                on_done(len(part))
            except BrokenProcessPool:
                suspects.append(part)
    for i, again in _one_by_one(job, drawn, [i for part in sorted(suspects, key=min) for i in part], keep):
        found[i] = again
        on_done(1)
    return [found[i] for i in range(len(drawn))]


def _one_by_one(
    job: Job, drawn: Sequence[tuple[np.ndarray, int]], rows: Sequence[int], keep: frozenset[int]
) -> Iterator[tuple[int, Again]]:
    """Each rollout alone, so that one that ends its process takes no other with it."""
    left = list(rows)
    while left:
        with _pool(job, 1) as pool:
            while left:
                row = left.pop(0)
                try:
                    yield row, pool.submit(_run, [drawn[row]], [row in keep]).result()[0]
                except BrokenProcessPool:
                    yield row, Again(np.nan, "error", "the process that ran it died", None, None)
                    break


def _pool(job: Job, workers: int) -> ProcessPoolExecutor:
    return ProcessPoolExecutor(
        workers, multiprocessing.get_context("spawn"), initializer=_open, initargs=(job,)
    )


_problem: Problem | None = None
_simulator: Simulator | None = None  # of the worker process


def _open(job: Job) -> None:
    global _problem, _simulator
    _problem = Problem(job)
    _simulator = _problem.simulator()


def _run(drawn: Sequence[tuple[np.ndarray, int]], traced: Sequence[bool]) -> list[Again]:
    assert _problem is not None
    assert _simulator is not None
    return [
        again if keep else replace(again, trace=None)
        for keep, again in (
            (keep, look(_problem, _simulator, x, noise))
            for keep, (x, noise) in zip(traced, drawn, strict=True)
        )
    ]


def look(problem: Problem, simulator: Simulator, x: np.ndarray, noise: int) -> Again:
    """One rollout, looked at in this process."""
    trace = record(problem, simulator, x, noise)
    result = trace.rollout
    if result.error is not None:
        return Again(result.f, result.outcome, result.error, None, None)
    motion = motion_of(trace, problem.job.scenario.safety.rays, problem.corridor)
    return Again(result.f, result.outcome, None, motion, trace)
