"""An export made in a process of its own, because SUMO allows one simulation a process."""

import multiprocessing
import tempfile
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from pathlib import Path

import numpy as np

from service.analysis.exports.write import FORMATS, Exports, write_exports
from service.errors import InputError, WorkerError
from service.evaluation.job import Job, Problem
from service.evaluation.pool import watch_parent


def export_bytes(job: Job, x: np.ndarray, noise_seed: int, title: str, form: str) -> bytes:
    """The rollout of x (d,) and its noise seed in one of FORMATS. Raises InputError for another form, SimulationError
    where the rollout fails, and WorkerError where its process ends."""
    if form not in FORMATS:
        raise InputError(f"format {form}: there are {', '.join(FORMATS)}")
    with ProcessPoolExecutor(1, multiprocessing.get_context("spawn"), initializer=watch_parent) as pool:
        try:
            return pool.submit(_export, job, x, noise_seed, title, form).result()
        except BrokenProcessPool as error:
            raise WorkerError("the process that ran the rollout again died") from error


def _export(job: Job, x: np.ndarray, noise_seed: int, title: str, form: str) -> bytes:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"rollout{FORMATS[form][1]}"
        write_exports(Problem(job), x, noise_seed, title, Exports(**{form: path}))
        return path.read_bytes()
