"""What a lidar ego does in an emergency: braking and moving over within its lane, from one scan of its own beams.

As in vehicles that are built, it stands beside the policy and overrules it only where it asks for less acceleration or
a push aside. It keeps no memory: what it does is a function of the observation, so a rollout's state needs nothing
more. A beam's hit says where a part of another vehicle is and how fast it closes along the beam; lateral motion is not
told apart from it.

Ahead. The beams within 54 degrees of straight ahead count, where their hits lie beside the own sides by less than
PATH_M. For the beam next to the one straight ahead that is wider than the own path: a vehicle that straddles the
marking is hit at the far end of its rear, by that beam only and no sooner than 6 m ahead. Where stopping MARGIN_M
before it takes more than REQUIRED_MPS2, or the gap is closed within TIME_S, the ego brakes BRAKE_GAIN times as hard as
required and BRAKE_EXTRA_MPS2 harder; nearer than STAND_OFF_M it also keeps from following closer.

Beside. Where a side is nearer than ROOM_M the ego is pushed away from it, the less the nearer it is to its own
marking on the other side. Where one is nearer than CLOSE_M and has nothing beside the ego's rear half, the ego falls
back behind it.
"""

import math

import numpy as np

from policies import layout
from policies.exactmath import sincos
from policies.jit import kernel

AHEAD_BEAMS = 3  # on either side of straight ahead
PATH_M = (1.6, 1.6, 0.5, 0.5)  # straight ahead, the beams next to it, and so on
MARGIN_M, LEAST_ROOM_M = 0.7, 0.2
LEAST_CLOSING_MPS = 0.05
STAND_OFF_M, STAND_OFF_CLOSING_MPS, STAND_OFF_MPS2 = 2.0, -0.3, 0.5
REQUIRED_MPS2, TIME_S = 1.0, 2.0
BRAKE_GAIN, BRAKE_EXTRA_MPS2 = 1.25, 0.5
HARDEST_MPS2 = 7.5
BESIDE_BEAMS = (2, 8)  # the first and the last on a side
REAR_BEAMS = (6, 8)  # of them, those that look at the own rear half
ROOM_M, PUSH_MPS2 = 0.9, 2.0  # an acceleration across
CLOSE_M, FALL_BACK_MPS2 = 0.45, 2.0
WITHIN_LANE_M = 0.9  # from the lane's middle, as far as it moves over
STEERING_SPEED_FLOOR_MPS = 4.0
HOLD_S = 0.1  # an action is held so long: braking ends at a standstill

# Sines and cosines of the beams on the left; those on the right mirror them. Not compiled: the bits are the same, and a
# process that drives nobody need not load compiled code.
_LEFT = [sincos.py_func(2.0 * math.pi * i / layout.BEAMS) for i in range(10)]
_SINES, _COSINES = (np.array(column) for column in zip(*_LEFT, strict=True))


@kernel
def _braking(observation: np.ndarray, half_length_m: float, half_width_m: float) -> float:
    """Deceleration (m/s^2) that what is ahead asks for; 0 for none."""
    brake = 0.0
    for step in range(-AHEAD_BEAMS, AHEAD_BEAMS + 1):
        beam = step % layout.BEAMS
        distance = observation[layout.RANGE_M + beam]
        if distance >= layout.LIDAR_RANGE_M:
            continue
        cosine = _COSINES[abs(step)]
        gap = distance * cosine - half_length_m
        room = distance * _SINES[abs(step)] - half_width_m
        closing = -observation[layout.RANGE_RATE_MPS + beam] / cosine
        if gap <= 0.0 or room > PATH_M[abs(step)]:
            continue
        if gap < STAND_OFF_M and closing > STAND_OFF_CLOSING_MPS:
            brake = max(brake, STAND_OFF_MPS2)
        if closing <= LEAST_CLOSING_MPS:
            continue
        required = closing * closing / (2.0 * max(gap - MARGIN_M, LEAST_ROOM_M))
        if required > REQUIRED_MPS2 or gap < TIME_S * closing:
            brake = max(brake, min(BRAKE_GAIN * required + BRAKE_EXTRA_MPS2, HARDEST_MPS2))
    return brake


@kernel
def _room(observation: np.ndarray, side: int, half_width_m: float) -> tuple[float, bool]:
    """Room (m) to who is beside on a side (1: left, -1: right), and whether anybody within ROOM_M is beside the rear
    half."""
    least, at_the_rear = math.inf, False
    for step in range(BESIDE_BEAMS[0], BESIDE_BEAMS[1] + 1):
        distance = observation[layout.RANGE_M + (side * step) % layout.BEAMS]
        if distance >= layout.LIDAR_RANGE_M:
            continue
        room = distance * _SINES[step] - half_width_m
        least = min(least, room)
        at_the_rear = at_the_rear or (step >= REAR_BEAMS[0] and room < ROOM_M)
    return least, at_the_rear


@kernel
def intervene(
    observation: np.ndarray, acceleration_mps2: float, turn_rate_radps: float
) -> tuple[float, float]:
    """The action (m/s^2, rad/s) in place of the policy's at this observation (51,)."""
    half_width = 0.5 * observation[layout.WIDTH_M]
    brake = _braking(observation, 0.5 * observation[layout.LENGTH_M], half_width)
    left, left_rear = _room(observation, 1, half_width)
    right, right_rear = _room(observation, -1, half_width)
    push = 0.0
    if left < ROOM_M:
        push -= PUSH_MPS2 * (1.0 - left / ROOM_M)
    if right < ROOM_M:
        push += PUSH_MPS2 * (1.0 - right / ROOM_M)
    offset = observation[layout.LANE_OFFSET_M]
    if push * offset > 0.0:
        push *= max(0.0, 1.0 - abs(offset) / WITHIN_LANE_M)
    if (left < CLOSE_M and not left_rear) or (right < CLOSE_M and not right_rear):
        brake = max(brake, FALL_BACK_MPS2)
    speed = observation[layout.SPEED_MPS]
    if brake > 0.0:
        brake = min(brake, max(speed, 0.0) / HOLD_S)
        acceleration_mps2 = min(acceleration_mps2, -brake)
    return acceleration_mps2, turn_rate_radps + push / max(speed, STEERING_SPEED_FLOOR_MPS)
