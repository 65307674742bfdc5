"""The demonstrator that egos learn from: a careful driver who also sees conflicts coming and avoids them.

The careful driver (service.training.expert, lane_changes) knows what the lidar shows. Conflicts are found among the
vehicles themselves, hidden ones included, and straight on: with the speeds along and across the road of this moment,
who will be in the ego's path by the time it gets there? So it sees a slower vehicle that straddles the marking, and one
that drifts over from the lane beside at 0.2 m/s. What the ego's network then learns is the mean of this over what its
lidar cannot tell apart.

Ahead: braking to a speed no higher than the other's, MARGIN_M before it. Where that takes more than REQUIRED_MPS2, or a
collision is nearer than TTC_S, the demonstrator brakes BRAKE_GAIN times as hard and BRAKE_EXTRA_MPS2 harder. Unlike the
drivers' conflict avoidance it has no reaction time.

Beside, and while it brakes: it moves over within its own lane, away from who is too near or nearing, as far as the
other side is free.
"""

import math

import numpy as np

from policies import layout as O
from policies.exactmath import sincos
from policies.jit import kernel
from service.errors import InputError
from service.training.expert import STEERING_SPEED_FLOOR_MPS, Expert, mean_action
from service.world import agents as A

LOOK_AHEAD_S = 4.0  # how long the present speeds are taken to last
LEAST_ACROSS_MPS = 0.1  # lateral closing speed that counts
IN_PATH_M = 0.4  # lateral room below which a vehicle is in the path
MARGIN_M = 2.0  # between the bumpers when the braking ends
TTC_S, LEAST_CLOSING_MPS = 4.0, 1.0
REQUIRED_MPS2 = 0.7
BRAKE_GAIN, BRAKE_EXTRA_MPS2 = 1.25, 0.5
HARDEST_MPS2 = 7.5
COMFORTABLE_ROOM_M = 0.9  # side to side
BESIDE_M, BESIDE_S = (
    2.0,
    0.5,
)  # longitudinal gap of who counts as beside: metres, and seconds of closing speed
SIDE_LOOK_AHEAD_S = 2.0
SWERVE_MPS2 = 1.5  # the strongest push across
WITHIN_LANE_M = 0.75  # from the lane's middle, as far as it moves over
FREE_ROOM_M = 0.8  # on the other side

NOTHING = (math.inf, 0.0)  # what avoiding conflicts asks where there are none


@kernel
def avoid(agents: np.ndarray, own: int, spacing_m: float) -> tuple[float, float]:
    """What avoiding conflicts asks of vehicle `own`: the highest acceleration that is left to it (m/s^2, inf: any), and
    an acceleration across the road (m/s^2, positive to the left).

    agents: (V, columns) as `service.world.sim.step.observe` leaves them.
    """
    me = agents[own]
    station = me[A.STATION] * spacing_m + me[A.ALONG_M]
    sine, _ = sincos(me[A.LANE_HEADING_RAD])
    across_mps = me[A.SPEED_MPS] * sine
    brake, push = 0.0, 0.0
    free_left, free_right = math.inf, math.inf
    for j in range(agents.shape[0]):
        you = agents[j]
        if j == own or you[A.ACTIVE] == 0.0:
            continue
        along = you[A.STATION] * spacing_m + you[A.ALONG_M] - station
        if along < -40.0 or along > 100.0:
            continue
        offset = you[A.OFFSET_M] - me[A.OFFSET_M]
        side = 1.0 if offset > 0.0 else -1.0
        gap = abs(along) - 0.5 * (me[A.LENGTH_M] + you[A.LENGTH_M])
        room = abs(offset) - 0.5 * (me[A.WIDTH_M] + you[A.WIDTH_M])
        sine, _ = sincos(you[A.LANE_HEADING_RAD])
        nearing = side * (across_mps - you[A.SPEED_MPS] * sine)
        if abs(nearing) < LEAST_ACROSS_MPS:
            nearing = 0.0
        closing = me[A.SPEED_MPS] - you[A.SPEED_MPS]
        if gap < BESIDE_M + 1.0 * abs(closing):
            if side > 0.0:
                free_left = min(free_left, room)
            else:
                free_right = min(free_right, room)
        needed_room = room
        if along > 0.0 and gap > 0.0:
            if closing <= 0.0:
                continue
            arrival = gap / closing
            horizon = min(arrival, LOOK_AHEAD_S)
            needed_room = min(room, room - nearing * horizon)
            if needed_room < IN_PATH_M:
                required = closing * closing / (2.0 * max(gap - MARGIN_M, 0.3))
                if required > REQUIRED_MPS2 or (arrival < TTC_S and closing > LEAST_CLOSING_MPS):
                    brake = max(brake, min(BRAKE_GAIN * required + BRAKE_EXTRA_MPS2, HARDEST_MPS2))
            if arrival > TTC_S or room < -0.9:  # too far to move over for, or straight ahead
                continue
        elif gap < BESIDE_M + BESIDE_S * max(0.0, -closing if along < 0.0 else closing):
            needed_room = min(room, room - nearing * SIDE_LOOK_AHEAD_S)
            if along > 1.0 and needed_room < 0.0:  # it comes over ahead of the middle: fall back behind it
                brake = max(brake, 2.0)
        else:
            continue
        push -= side * SWERVE_MPS2 * min(max(1.0 - needed_room / COMFORTABLE_ROOM_M, 0.0), 1.0)
    push = min(max(push, -SWERVE_MPS2), SWERVE_MPS2)
    free = free_left if push > 0.0 else free_right
    push *= min(max(free / FREE_ROOM_M, 0.0), 1.0)
    if push * me[A.LANE_OFFSET_M] > 0.0:  # the nearer its lane's marking, the less
        push *= min(max(1.0 - abs(me[A.LANE_OFFSET_M]) / WITHIN_LANE_M, 0.0), 1.0)
    return (-brake if brake > 0.0 else math.inf), push


def is_attentive(name: str) -> bool:
    """Whether the demonstrator called `name` avoids conflicts; InputError for a name that is none."""
    if name not in ("attentive", "careful"):
        raise InputError(f"--demonstrator {name}: expected attentive or careful")
    return name == "attentive"


def demonstrated(expert: Expert, seen: np.ndarray, avoidance: np.ndarray) -> np.ndarray:
    """Actions (n, 2) in m/s^2 and rad/s of the demonstrator at observations (n, 51).

    avoidance (n, 2): see `avoid`
    """
    action = mean_action(expert, seen)
    action[:, 0] = np.minimum(action[:, 0], avoidance[:, 0])
    speed = np.maximum(seen[:, O.SPEED_MPS].astype(np.float64), STEERING_SPEED_FLOOR_MPS)
    turn = action[:, 1] + avoidance[:, 1] / speed
    action[:, 1] = np.clip(turn, -O.MAX_TURN_RATE_RADPS, O.MAX_TURN_RATE_RADPS)
    return action
