"""Gymnasium environments of tailroad's scenarios, for egos that are trained: `gymnasium.make("tailroad/I80-v0")`.

    import gymnasium
    import tailroad.gym

    env = gymnasium.make("tailroad/I80-v0")                          # i80-10s, 51 values, two actions
    env = gymnasium.make("tailroad/US101-v0", observation="camera")  # us101-10s, with the picture
    env = gymnasium.make("tailroad/I80-v0", scenario="mine.toml")    # a scenario of your own

TrafficEnv        what they are; Step and default_reward: what a reward is given for, and the one they have
export_policy     writes what was learned as a file for `tailroad estimate --ego onnx:FILE`

Needs the extra `gym` (pip install '.[gym]'). The import makes the environments known; `gymnasium.make` imports it
itself by the name "tailroad.gym:tailroad/I80-v0". `export_policy` needs the extra `train`.
"""

from pathlib import Path
from typing import TYPE_CHECKING

import gymnasium

from service.world.environment import Step, TrafficEnv, default_reward

__all__ = ["Step", "TrafficEnv", "default_reward", "export_policy", "register"]

if TYPE_CHECKING:
    from torch import nn

ENVIRONMENTS = {"I80": "i80-10s", "US101": "us101-10s"}


def register() -> None:
    """Make the environments known to Gymnasium: tailroad/I80-v0 and tailroad/US101-v0; again is the same."""
    for name, scenario in ENVIRONMENTS.items():
        if (known := f"tailroad/{name}-v0") not in gymnasium.registry:
            gymnasium.register(
                known, entry_point="service.world.environment:TrafficEnv", kwargs={"scenario": scenario}
            )


def export_policy(actor: "nn.Module", env: TrafficEnv, path: str | Path) -> Path:
    """Write a policy that was trained in `env` as a file for `--ego onnx:FILE`, and say where it is.

    actor: a torch module, observations of `env` (n, 51) float32 to its actions (n, 2)
    env: that it was trained in; its scaling and limits become part of the file

    InputError for an environment with a camera.
    """
    from service.training.policy_export import export  # PyTorch takes seconds to import

    return export(actor, env, Path(path))


register()
