"""The lidar ego: an imitation network on the 51 values, lidar first (the paper's non-vision policy).

It drives with the mean of the network's action, so it has no randomness of its own. Where its weights say so, braking
and moving over in an emergency stand beside the network (policies.egos.emergency).
"""

import numpy as np

from policies.drivers import DriverModel
from policies.egos.compiled import NETWORK, NETWORK_WITH_EMERGENCY, act
from policies.egos.protocol import Observation
from policies.layout import OUTPUTS


class LidarEgo:
    name = "lidar"

    def __init__(self, model: DriverModel):
        self.kind = NETWORK_WITH_EMERGENCY if model.emergency else NETWORK
        self.weights = (
            model.w1,
            model.b1,
            model.w2,
            model.b2,
            model.mu0.astype(np.float32),
            model.action_scale,
        )
        self._outputs = np.empty(OUTPUTS, np.float32)

    def reset(self, seed: int) -> None:
        pass

    def act(self, observation: Observation) -> tuple[float, float]:
        return act(self.kind, observation.vector, *self.weights, self._outputs)
