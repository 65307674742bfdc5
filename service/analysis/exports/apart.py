"""An export made in a process of its own, because SUMO allows one simulation a process."""

import tempfile
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from pathlib import Path

import numpy as np

from service.analysis.exports.write import Files, write_exports, write_forms
from service.analysis.failures.rerun import Rerun, rerun
from service.analysis.rollout_files import SUFFIXES
from service.errors import InputError, WorkerError
from service.evaluation.job import Job, Problem
from service.evaluation.parent import end_with_parent
from service.evaluation.processes import context_for
from service.world.egos.here import HERE
from service.world.scenario.noise import Noise


def export_bytes(job: Job, x: np.ndarray, noise_seed: Noise, title: str, form: str) -> bytes:
    """The rollout of x (d,) and its noise seed in one of the forms of SUFFIXES.

    Raises InputError for another form, SimulationError where the rollout fails, and WorkerError where its process ends.
    """
    if form not in SUFFIXES:
        raise InputError(f"format {form}: there are {', '.join(SUFFIXES)}")
    with (
        tempfile.TemporaryDirectory() as folder,
        ProcessPoolExecutor(1, context_for(job.ego), initializer=end_with_parent) as pool,
    ):
        path = Path(folder) / f"rollout{SUFFIXES[form]}"
        files = {form: path}
        try:
            if not job.ego.startswith(HERE):
                pool.submit(_export, job, x, noise_seed, title, files).result()
            else:  # in a fork, which has this process's locks, only what needs the ego
                again = pool.submit(_look, job, x, noise_seed, files.get("fcd")).result()
                write_forms(Problem(job), again, x, noise_seed, title, files)
        except BrokenProcessPool as error:
            raise WorkerError("the process that ran the rollout again died") from error
        return path.read_bytes()


def _export(job: Job, x: np.ndarray, noise_seed: Noise, title: str, files: Files) -> None:
    write_exports(Problem(job), x, noise_seed, title, files)


def _look(job: Job, x: np.ndarray, noise_seed: Noise, fcd: Path | None) -> Rerun:
    problem = Problem(job)
    with problem.simulator(fcd=fcd) as simulator:
        return rerun(problem, simulator, x, noise_seed)
