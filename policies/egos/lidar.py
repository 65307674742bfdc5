"""The lidar ego: an imitation network on the 51 values, lidar first (the paper's non-vision policy).

It drives with the mean of the network's action, so it has no randomness of its own.
"""

import numpy as np

from policies.drivers import DriverModel
from policies.egos.protocol import Observation
from policies.jit import kernel
from policies.layout import OUTPUTS
from policies.network import forward, sample_action


@kernel
def _mean_action(
    observation: np.ndarray, w1: np.ndarray, b1: np.ndarray, w2: np.ndarray, b2: np.ndarray, head: np.ndarray,
    action_scale: np.ndarray,
) -> tuple[float, float]:  # fmt: skip
    outputs = np.empty(OUTPUTS, np.float32)
    forward(observation, w1, b1, w2, b2, head, outputs)
    return sample_action(outputs, action_scale, 0.0, 0.0)


class LidarEgo:
    name = "lidar"

    def __init__(self, model: DriverModel):
        self.weights = (
            model.w1,
            model.b1,
            model.w2,
            model.b2,
            model.mu0.astype(np.float32),
            model.action_scale,
        )

    def reset(self, seed: int) -> None:
        pass

    def act(self, observation: Observation) -> tuple[float, float]:
        return _mean_action(observation.vector, *self.weights)
