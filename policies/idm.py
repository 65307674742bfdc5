"""A lane-keeping intelligent driver (Treiber et al. 2000) that acts on the same observation as the networks."""

import math

import numpy as np

from policies import layout
from policies.exactmath import sincos
from policies.jit import kernel

TIME_HEADWAY_S = 1.2
MINIMUM_GAP_M = 2.0
COMFORTABLE_DECELERATION_MPS2 = 2.0
MAXIMUM_ACCELERATION_MPS2 = 1.5
CORRIDOR_HALF_WIDTH_M = 1.8  # a beam's hit this close to the own path is a leader (half a lane)

LATERAL_GAIN_PER_S2 = 0.3  # lateral acceleration wanted for a metre of offset
LATERAL_DAMPING_PER_S = 1.0  # and for a metre per second of lateral speed
STEERING_SPEED_FLOOR_MPS = 3.0
HOLD_S = 0.1  # an action is held this long


@kernel
def leader_gap(observation: np.ndarray) -> tuple[float, float]:
    """Bumper gap (m) to and closing speed (m/s) on the nearest vehicle in the own path; inf and 0 for none.

    Beams within 45 degrees of straight ahead count where their hit lies in the own path. Gaps below a beam
    spacing can hide a vehicle; that is the sensor's limit.
    """
    gap = math.inf
    closing = 0.0
    for step in range(-2, 3):
        beam = step % layout.BEAMS
        distance = observation[layout.RANGE_M + beam]
        if distance >= layout.LIDAR_RANGE_M:
            continue
        sine, cosine = sincos(2.0 * math.pi * step / layout.BEAMS)
        if abs(distance * sine) > CORRIDOR_HALF_WIDTH_M:
            continue
        ahead = distance * cosine - 0.5 * observation[layout.LENGTH_M]
        if ahead < gap:
            gap = ahead
            closing = -observation[layout.RANGE_RATE_MPS + beam] * cosine
    return gap, closing


@kernel
def lane_keeping_turn_rate(observation: np.ndarray) -> float:
    """Turn rate (rad/s) that follows the lane and removes lateral offset and heading error."""
    speed = max(observation[layout.SPEED_MPS], STEERING_SPEED_FLOOR_MPS)
    sine, _ = sincos(observation[layout.LANE_HEADING_RAD])
    lateral_acceleration = (
        -LATERAL_GAIN_PER_S2 * observation[layout.LANE_OFFSET_M] - LATERAL_DAMPING_PER_S * speed * sine
    )
    follow_lane = observation[layout.SPEED_MPS] * observation[layout.LANE_CURVATURE_PER_M]
    return follow_lane + lateral_acceleration / speed


@kernel
def idm_action(observation: np.ndarray, desired_speed_mps: float) -> tuple[float, float]:
    """Acceleration (m/s^2) and turn rate (rad/s) of the intelligent driver model with lane keeping."""
    speed = observation[layout.SPEED_MPS]
    gap, closing = leader_gap(observation)
    ratio = speed / desired_speed_mps
    free = 1.0 - (ratio * ratio) * (ratio * ratio)
    interaction = 0.0
    if gap < math.inf:
        wanted = MINIMUM_GAP_M + max(
            0.0,
            speed * TIME_HEADWAY_S
            + speed * closing / (2.0 * math.sqrt(MAXIMUM_ACCELERATION_MPS2 * COMFORTABLE_DECELERATION_MPS2)),
        )
        share = wanted / max(gap, 0.1)
        interaction = share * share
    acceleration = MAXIMUM_ACCELERATION_MPS2 * (free - interaction)
    # braking ends at a standstill
    acceleration = max(acceleration, -layout.MAX_DECELERATION_MPS2, -max(speed, 0.0) / HOLD_S)
    return acceleration, lane_keeping_turn_rate(observation)
