"""Motion of a controlled vehicle: acceleration and turn rate held for a step."""

import numpy as np

from policies.exactmath import sincos
from policies.jit import kernel
from policies.layout import (
    MAX_ACCELERATION_MPS2,
    MAX_DECELERATION_MPS2,
    MAX_TURN_RATE_RADPS,
    MIN_TURN_RADIUS_M,
)
from service.world import agents as A


@kernel
def advance(
    agent: np.ndarray, acceleration_mps2: float, turn_rate_radps: float, dt_s: float, may_reverse: bool
) -> None:
    """Move a vehicle by one step with the action clipped to what a vehicle can do.

    The speed changes by a dt, the heading by w dt; the position by the mean speed along the mean heading. A vehicle
    that may not reverse stops at speed 0.
    """
    a = min(max(acceleration_mps2, -MAX_DECELERATION_MPS2), MAX_ACCELERATION_MPS2)
    sharpest = min(MAX_TURN_RATE_RADPS, abs(agent[A.SPEED_MPS]) / MIN_TURN_RADIUS_M)
    w = min(max(turn_rate_radps, -sharpest), sharpest)
    speed = agent[A.SPEED_MPS] + a * dt_s
    if speed < 0.0 and not may_reverse:
        speed = 0.0
    sine, cosine = sincos(agent[A.HEADING_RAD] + 0.5 * w * dt_s)
    distance = 0.5 * (agent[A.SPEED_MPS] + speed) * dt_s
    agent[A.ACCELERATION_MPS2] = (speed - agent[A.SPEED_MPS]) / dt_s
    agent[A.TURN_RATE_RADPS] = w
    agent[A.X_M] += distance * cosine
    agent[A.Y_M] += distance * sine
    agent[A.SPEED_MPS] = speed
    agent[A.HEADING_RAD] += w * dt_s
