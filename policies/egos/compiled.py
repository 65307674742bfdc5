"""The egos that compiled loops drive with: which kind one is, and its action at an observation."""

import numpy as np

from policies.egos.emergency import intervene
from policies.egos.idm import DESIRED_SPEED_MPS
from policies.idm import idm_action
from policies.jit import kernel
from policies.network import forward, sample_action

# the intelligent driver; a network's mean action; the same with what it does in an emergency (policies.egos.emergency)
IDM, NETWORK, NETWORK_WITH_EMERGENCY = range(3)


@kernel
def act(
    kind: int, observation: np.ndarray, w1: np.ndarray, b1: np.ndarray, w2: np.ndarray, b2: np.ndarray,
    head: np.ndarray, action_scale: np.ndarray, outputs: np.ndarray,
) -> tuple[float, float]:  # fmt: skip
    """Acceleration (m/s^2) and turn rate (rad/s) of an ego of that kind at an observation (51,).

    w1 to action_scale: see `policies.network`; the intelligent driver reads none of them
    outputs: (4,) float32, overwritten
    """
    if kind == IDM:
        return idm_action(observation, DESIRED_SPEED_MPS)
    forward(observation, w1, b1, w2, b2, head, outputs)
    acceleration, turn_rate = sample_action(outputs, action_scale, 0.0, 0.0)
    if kind == NETWORK_WITH_EMERGENCY:
        return intervene(observation, acceleration, turn_rate)
    return acceleration, turn_rate
