"""Runs jobs in a run directory, from wherever it stands, and tells how far it is."""

import time
from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field
from datetime import datetime
from pathlib import Path
from typing import Any

import ce
from service.analysis.run.progress import Progress, Tell, tell_nobody, told
from service.analysis.run.run import Run
from service.evaluation.cores import core_count
from service.evaluation.failed_share import MAX_FAILED
from service.evaluation.job import Job, compiled
from service.evaluation.path_store import GIVEN
from service.evaluation.pool import WORLDS, InSumo, OpenWorld
from service.evaluation.recorded import Watcher, evaluate_recorded
from service.evaluation.store import Chunk, RunDirectory
from service.evaluation.summary import Cost
from service.world.egos.here import give_again
from service.world.egos.open import check_ego

RUNS = Path("runs")  # where runs go that are given no folder


class Interrupted(KeyboardInterrupt):
    """A run was interrupted: what was run is kept in `path`, and `resume` goes on with it."""

    def __init__(self, path: Path):
        super().__init__(f"interrupted; what was run is kept: tailroad.resume({str(path)!r}) goes on with it")
        self.path = path


def plain(word: str) -> str:
    """A word that can stand in a file's name."""
    return "".join(c if c.isalnum() or c in "._-" else "-" for c in word)


def new_folder(*words: str) -> Path:
    """A run directory's path for a run that is given none."""
    return RUNS / "-".join([*map(plain, words), f"{datetime.now():%Y%m%d-%H%M%S}"])


@dataclass
class _Told:
    """Passes on what happens to a job as a job's progress, and adds up what it costs."""

    job: Job
    path: Path
    workers: int
    tell: Tell
    cost: Cost
    rollouts: int = 0
    total: int = 0
    record: ce.TrainingRecord | ce.EstimationRecord | None = None
    watcher: Watcher = field(init=False)

    def __post_init__(self) -> None:
        self.watcher = Watcher(self._begun, self._chunk, self._batch)

    def _say(self, more: int = 0) -> None:
        self.tell(Progress(self.job, self.path, self.workers, self.rollouts, self.total, more, self.record))

    def _begun(self, job: Job, total: int) -> None:
        self.total = total
        self._say()

    def _chunk(self, chunk: Chunk, replayed: bool) -> None:
        sim_s = float(chunk.steps.sum()) * self.job.scenario.time.step_s
        self.cost.add(chunk.worker_s, sim_s, chunk.driven_in_sumo)
        self.rollouts += chunk.stop - chunk.start
        self._say(chunk.stop - chunk.start)

    def _batch(self, state: Any, record: ce.TrainingRecord | ce.EstimationRecord) -> None:
        self.record = record
        self._say()


def carry_out(
    path: Path,
    jobs: Sequence[Job],
    workers: int | None = None,
    progress: Tell = tell_nobody,
    max_failed: float = MAX_FAILED,
    open_world: OpenWorld = compiled,
    executor: Executor | None = None,
    new: bool = False,
    committor: bytes | None = None,
) -> Run:
    """Run the jobs in the run directory at `path`, a new one or one of the same jobs, to their end.

    workers: processes (default: one for each core)
    progress: told how far it is
    max_failed: TooManyFailures where a larger share of the rollouts fails
    open_world: what rollouts run in
    executor: where they run instead of in processes of this one's own
    new: refuse a directory that holds a run already
    committor: that jobs of paths were given

    Raises Interrupted at Ctrl-C and StoreError where the directory belongs to other jobs.
    """
    opened = RunDirectory.create if new else RunDirectory.open_or_create
    with opened(path, tuple(jobs)) as store:
        for job in store.jobs:
            if committor is not None and job.committor_sha256:
                store.artefacts.keep(job.id, GIVEN, committor)
        return _run_all(store, workers or core_count(), progress, max_failed, open_world, executor)


def resume(
    path: str | Path,
    ego: Any = None,
    *,
    workers: int | None = None,
    progress: Tell | bool = True,
    max_failed: float = MAX_FAILED,
    in_sumo: InSumo = "some",
    executor: Executor | None = None,
) -> Run:
    """Go on with the run in this directory: its own settings hold, and what was run is not run again.

    ego: needed again where the run's ego was an object of the Python process that began it
    workers, progress, max_failed, in_sumo, executor: as of `estimate`
    """
    with RunDirectory.open(Path(path), to_go_on=True) as store:
        for job in store.jobs:
            if ego is not None:
                give_again(job.ego, ego)
            check_ego(job.ego)  # a run directory may come from someone else
        count = workers or core_count()
        with told(progress, count) as tell:
            return _run_all(store, count, tell, max_failed, WORLDS[in_sumo], executor)


def _run_all(
    store: RunDirectory,
    workers: int,
    tell: Tell,
    max_failed: float,
    open_world: OpenWorld,
    executor: Executor | None,
) -> Run:
    estimates: dict[str, ce.Estimate] = {}
    costs: dict[str, Cost] = {}
    try:
        for job in store.jobs:
            costs[job.id] = Cost(workers)
            passed_on = _Told(job, store.path, workers, tell, costs[job.id])
            began = time.perf_counter()
            estimates[job.id] = evaluate_recorded(
                store, job, workers, passed_on.watcher, max_failed, open_world, executor=executor
            )
            costs[job.id].wall_s = time.perf_counter() - began
    except KeyboardInterrupt:
        raise Interrupted(store.path) from None
    return Run(store.path, store.jobs, estimates, costs, workers)
