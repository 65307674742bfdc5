"""Runs cells on this machine, each in a run directory of its own that the same command goes on with."""

from collections.abc import Iterator, Sequence
from pathlib import Path

import msgspec

from service.analysis.run import carry_out, jobs_of
from service.errors import ScenarioError, TailroadError
from service.evaluation.job import Job
from service.evaluation.options import COMMON
from service.front.matrix.plan import Cell
from service.front.matrix.verdict import Result, result_of


def jobs_of_cells(cells: Sequence[Cell]) -> list[Job]:
    """The cells as jobs, all checked before one is run."""
    return [job for cell in cells for job in _job_of(cell)]


def _job_of(cell: Cell) -> tuple[Job, ...]:
    common = {name: cell.options[name] for name in COMMON}
    own = {name: value for name, value in cell.options.items() if name not in COMMON}
    return jobs_of(
        cell.scenario, cell.ego, cell.gamma, cell.method, seed=cell.seed, options=own, meet=False, **common
    )


def run_locally(
    cells: Sequence[Cell], jobs: Sequence[Job], folder: Path, workers: int, limit: float | None
) -> Iterator[Result]:
    """The results one by one; a cell that cannot be run is one too, and the others go on."""
    for cell, job in zip(cells, jobs, strict=True):
        path = folder / cell.folder
        try:
            run = carry_out(path, [job], workers)
            yield result_of(cell, str(path), "done", "", msgspec.to_builtins(run.estimate), limit)
        except ScenarioError:
            raise
        except TailroadError as error:
            yield result_of(cell, str(path), "failed", str(error), None, limit)
