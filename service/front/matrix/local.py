"""Runs cells on this machine, each in a run directory of its own that the same command goes on with."""

from collections.abc import Iterator, Sequence
from pathlib import Path

from service.errors import ScenarioError, StoreError, TailroadError
from service.evaluation.campaign import Watcher, run_job
from service.evaluation.job import Job, make_job
from service.evaluation.store import Chunk, RunDirectory
from service.evaluation.summary import Cost, summary_of
from service.front.matrix.plan import Cell
from service.front.matrix.verdict import Result, result_of
from service.world.scenario import Scenario, load_scenario
from service.world.scenario.check import check_road

MAX_FAILED = 0.1  # share of failed rollouts at which a cell is given up


def jobs_of(cells: Sequence[Cell]) -> list[Job]:
    """The cells as jobs, all checked before one is run."""
    scenarios: dict[str, Scenario] = {}
    for name in dict.fromkeys(cell.scenario for cell in cells):
        scenarios[name] = load_scenario(name)
        check_road(scenarios[name], name)
    return [make_job(scenarios[c.scenario], c.ego, c.gamma, c.method, c.seed, c.options) for c in cells]


def run_locally(
    cells: Sequence[Cell], jobs: Sequence[Job], folder: Path, workers: int, limit: float | None
) -> Iterator[Result]:
    """The results one by one; a cell that cannot be run is one too, and the others go on."""
    for cell, job in zip(cells, jobs, strict=True):
        path = folder / cell.folder
        try:
            yield result_of(cell, str(path), "done", "", _run(job, path, workers), limit)
        except ScenarioError:
            raise
        except TailroadError as error:
            yield result_of(cell, str(path), "failed", str(error), None, limit)


def _run(job: Job, path: Path, workers: int) -> dict:
    cost = Cost(workers)

    def on_chunk(chunk: Chunk, replayed: bool) -> None:
        cost.add(chunk.worker_s, float(chunk.steps.sum()) * job.scenario.time.step_s)

    store = RunDirectory.open(path) if (path / "run.json").exists() else RunDirectory.create(path, (job,))
    with store:
        if store.jobs != (job,):
            raise StoreError(
                f"{path} holds a run of another job or of another version of tailroad; give another --out"
            )
        return summary_of(job, run_job(store, job, workers, Watcher(on_chunk=on_chunk), MAX_FAILED), cost)
