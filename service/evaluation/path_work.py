"""Roots of paths driven in worker processes: a part of a batch, a pure function of its roots and the plan.

Paths are driven without SUMO (`service.world.paths`). Of those that have ended a share is driven again in SUMO, each as
one rollout of its draw and noise, and must have the same bits (`service.world.sim.audited` says how large a share).
"""

import functools
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import msgspec
import numpy as np

import ce
from service.errors import SimulationError
from service.evaluation.job import Job, Problem
from service.evaluation.process_pool import OnProcesses, ProcessPool, TaskKind
from service.evaluation.processes import context_for
from service.evaluation.store import FAILED
from service.world.paths.process import HighwayPaths
from service.world.safety.contact_numbers import NUMBERS, contact_from
from service.world.sim.audited import EVERY, EVERY_EVENT
from service.world.sim.rollout import OUTCOMES, Simulator

ROOTS = 40  # of a part
EVENTS = 1  # of a part, that are all driven again in SUMO


@dataclass(frozen=True)
class PathWork:
    """Roots [start, start + n) of a batch.

    segments: of a whole path
    gamma: threshold of the event
    """

    start: int
    roots: ce.paths.Roots
    batch: ce.paths.PathBatch
    segments: int
    gamma: float

    def row(self, index: int) -> "PathWork":
        return replace(self, start=self.start + index, roots=self.roots.part(index, index + 1))


@dataclass(frozen=True)
class PathAnswer:
    """What they came to.

    worker_s: seconds of a worker that it took
    in_sumo: paths that SUMO has driven too
    """

    driven: ce.paths.Driven
    worker_s: float
    in_sumo: int = 0


_process: HighwayPaths | None = None  # of this worker process
_simulator: Simulator | None = None
_problem: Problem | None = None


def _open_worker(job: Job) -> None:
    global _problem, _process
    _problem = Problem(job)
    _process = _problem.paths


def _run(work: PathWork) -> PathAnswer:
    assert _process is not None
    began = time.perf_counter()
    driven = drive_part(_process, work)
    in_sumo = _audit(_process, work, driven)
    return PathAnswer(driven, time.perf_counter() - began, in_sumo)


def drive_part(process: HighwayPaths, work: PathWork) -> ce.paths.Driven:
    """Drive a part's roots in this process."""
    batch = work.batch
    return ce.paths.drive(
        process, work.roots, batch.levels, process.checkpoints, batch.plan, batch.committor, batch.record
    )


def _audit(process: HighwayPaths, work: PathWork, driven: ce.paths.Driven) -> int:
    """How many of the paths were driven again in SUMO; SimulationError where one did not come to the same."""
    chosen = _chosen(driven, work.gamma)
    for i in chosen:
        root = int(driven.root[i])
        x, noise = process.drawn(work.roots.x[root], int(work.roots.seeds[root]), driven.lineage[i])
        again = _opened().run(x, noise)
        same = again.f == driven.value[i] and again.outcome == OUTCOMES[int(driven.outcome[i])]
        if not same or again.contact != contact_from(driven.finals[i]):
            raise SimulationError(
                f"the path {noise} came to f = {driven.value[i]!r} ({OUTCOMES[int(driven.outcome[i])]}) without SUMO "
                f"and to f = {again.f!r} ({again.outcome}) with it: they must be the same to the bit. Report this"
            )
    return len(chosen)


def _chosen(driven: ce.paths.Driven, gamma: float) -> list[int]:
    """The paths that SUMO drives too: of a part's events the first, of the others one in EVERY_EVENT, and of those that
    are no event one in EVERY, by their last keys."""
    ends = np.maximum((driven.lineage != 0).sum(axis=1) - 1, 0)
    last = driven.lineage[np.arange(ends.size), ends]
    event = driven.value <= gamma
    wanted = np.where(event, last % np.uint64(EVERY_EVENT) == 0, last % np.uint64(EVERY) == 0)
    wanted[np.flatnonzero(event)[:EVENTS]] = True
    return [int(i) for i in np.flatnonzero(wanted & ~np.isnan(driven.value))]


def _opened() -> Simulator:
    global _simulator
    if _simulator is None:
        assert _problem is not None
        _simulator = _problem.simulator()
    return _simulator


def _rows(work: PathWork) -> list[PathWork]:
    return [work.row(i) for i in range(work.roots.size)]


def _joined(parts: Sequence[PathAnswer]) -> PathAnswer:
    return PathAnswer(
        ce.paths.joined([part.driven for part in parts]),
        sum(part.worker_s for part in parts),
        sum(part.in_sumo for part in parts),
    )


def _lost(work: PathWork) -> PathAnswer:
    """A root whose process died each time: a path that failed."""
    none = np.zeros((1, work.batch.levels.size))
    return PathAnswer(
        ce.paths.Driven(
            none, none.astype(np.int64), np.zeros(1, np.int64), np.ones(1, np.int64), np.zeros(1, np.int64),
            work.roots.weights, np.full(1, np.nan), np.zeros((1, work.segments), np.uint64), outcome=np.full(1, FAILED),
            finals=np.full((1, NUMBERS), np.nan),
        ),
        0.0,
    )  # fmt: skip


PATHS = TaskKind(_run, _rows, _joined, _lost)


class PathPool(OnProcesses[PathWork, PathAnswer]):
    """Worker processes for the paths of one job, started when first needed; use as a context manager."""

    def __init__(self, job: Job, workers: int, segments: int):
        """segments: of a whole path."""
        self._parts = functools.partial(_parts, segments=segments, gamma=job.gamma)
        super().__init__(ProcessPool(workers, PATHS, _open_worker, (job,), lambda: context_for(job.ego)))

    def run(self, batch: ce.paths.PathBatch) -> PathAnswer:
        """Drive a batch's roots: the same bits for any number of workers."""
        found: dict[int, PathAnswer] = {}
        for work, answer in self._processes.run(self._parts(batch)):
            found[work.start] = answer
        return _joined([found[start] for start in sorted(found)])


def _parts(batch: ce.paths.PathBatch, segments: int, gamma: float) -> Iterator[PathWork]:
    slim = msgspec.structs.replace(
        batch, roots=batch.roots.part(0, 0)
    )  # each part travels with its own roots alone
    for start in range(0, batch.roots.size, ROOTS):
        yield PathWork(start, batch.roots.part(start, start + ROOTS), slim, segments, gamma)
