"""Both drives of a conflict side by side: above as it was, below with the reference driver from the onset on."""

from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from pathlib import Path

import cv2
import numpy as np

from service.analysis.failures.motion import motion_of
from service.analysis.prevention.conflict import HandedOver, partner
from service.analysis.prevention.onset import onset_of
from service.analysis.trace import Trace
from service.analysis.video.film import HEIGHT, WIDTH, pictures
from service.errors import InputError, SimulationError, WorkerError
from service.evaluation.job import Job, Problem
from service.evaluation.parent import end_with_parent
from service.evaluation.processes import context_for
from service.world.scenario.noise import Noise


def both_traces(
    job: Job, x: np.ndarray, noise_seed: Noise, reference: str, onset_ttc_s: float
) -> tuple[Trace, Trace, float]:
    """The rollout as it was and with the reference driver, and when he takes over (s); in a process of its own.

    SimulationError where it cannot be run.
    """
    with ProcessPoolExecutor(1, context_for(job.ego), initializer=end_with_parent) as pool:
        try:
            return pool.submit(_both, job, x, noise_seed, reference, onset_ttc_s).result()
        except BrokenProcessPool as error:
            raise WorkerError("the process that ran the rollout again died") from error


def _both(
    job: Job, x: np.ndarray, noise_seed: Noise, reference: str, onset_ttc_s: float
) -> tuple[Trace, Trace, float]:
    problem = Problem(job)
    with HandedOver(problem, (reference,)) as world:
        before = world.as_it_was(x, noise_seed)
        if before.rollout.error is not None:
            raise SimulationError(f"the rollout failed: {before.rollout.error}")
        motion = motion_of(before, job.scenario.safety.rays, problem.corridor)
        onset = onset_of(before, partner(before, motion), onset_ttc_s)
        after = world.trace_of(reference, onset.step, x, noise_seed)
        if after.rollout.error is not None:
            raise SimulationError(f"the rollout with {reference} failed: {after.rollout.error}")
        return before, after, onset.time_s


def write_both(
    job: Job,
    x: np.ndarray,
    noise_seed: Noise,
    reference: str,
    onset_ttc_s: float,
    path: Path,
    title: str,
) -> tuple[Trace, Trace, float]:
    """Write the film (mp4) of both at real time; what they are of. The one that ends first stands still.

    InputError for another kind of file.
    """
    if path.suffix.lower() != ".mp4":
        raise InputError(f"--video {path}: films are written as .mp4; give a name that ends so")
    before, after, onset_s = both_traces(job, x, noise_seed, reference, onset_ttc_s)
    corridor = Problem(job).corridor
    step_s = float(before.time_s[1] - before.time_s[0]) if len(before.time_s) > 1 else 0.1
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"mp4v"), 1.0 / step_s, (WIDTH, 2 * HEIGHT))
    if not writer.isOpened():
        raise SimulationError(f"OpenCV cannot write films to {path}")
    above = pictures(before, corridor, f"{title}: {job.ego}")
    below = pictures(after, corridor, f"{reference} from {onset_s:.1f} s on")
    blank = np.zeros((HEIGHT, WIDTH, 3), np.uint8)
    upper = lower = blank
    try:
        for _ in range(max(len(before.time_s), len(after.time_s))):
            upper, lower = next(above, upper), next(below, lower)
            writer.write(np.concatenate([upper, lower]))
    finally:
        writer.release()
    return before, after, onset_s
