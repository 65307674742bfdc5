"""A dangerous rollout as a scenario file."""

import msgspec
import numpy as np

from service.evaluation.job import Problem
from service.world.scenario.fixed import fixed_of, toml_of
from service.world.scenario.noise import Noise


def scenario_text(problem: Problem, x: np.ndarray, noise_seed: Noise, f: float, title: str) -> str:
    """The text of a scenario file that holds the rollout of x (d,) and its noise seed.

    f: what it came to, in s
    """
    job = problem.job
    fixed = msgspec.structs.replace(
        fixed_of(job.scenario, problem.base, x, noise_seed),
        ego=job.ego,
        f=f,
        weights_sha256=job.weights_sha256,
    )
    comment = (
        f"{title}\n"
        f"One rollout of scenario {job.scenario.name}, written by tailroad {job.tailroad}. Run it with\n"
        "    tailroad rollout THIS_FILE [--video out.mp4]\n"
        "Change a value below [fixed] to see what would have been."
    )
    return toml_of(msgspec.structs.replace(job.scenario, fixed=fixed), comment)
