"""How an attentive driver takes a conflict and what it does about it.

Ahead. A vehicle is in the way when it is in the driver's path now, or will be by the time the driver gets there at the
present lateral speeds (a cut-in, predicted up to LOOK_AHEAD_S). The deceleration required is v^2 / 2d over the room
that is left at the end, with the braking distance of a leader who brakes counted in. It is a conflict below a time to
collision of 4 s or above a required 1 m/s^2: in naturalistic near-crashes braking begins within a second of an
inverse time to collision of 0.2 to 0.3 per second (Markkula et al. 2016, Accident Analysis and Prevention 95). The
driver reacts when a clock that runs while the conflict lasts passes its reaction time: median 0.9 s, lognormal (Green
2000, Transportation Human Factors 2: 0.7 s for expected, 1.25 s for unexpected events, 1.5 s for surprises). The
clock runs faster, up to twice, the shorter the time to collision: looming evidence accumulates (Markkula et al. 2016;
Engström et al. 2024, Accident
Analysis and Prevention). Braking aims at 1.25 times the required deceleration plus
0.5 m/s^2, up to 7.5 m/s^2, and builds up at 12.65 m/s^3 (the careful and competent human driver of UN Regulation 157:
0.774 g at that jerk).

Beside. A driver who moves across towards a neighbour gives up its lane change where the gap along the road is below
2.5 m + 3 s times the closing speed and the boxes would meet across within SIDE_S: it goes back to the middle of the
lane that it came from, and does not wait on the marking. One who is moved upon, or has less than NARROW_M beside it,
makes room after its reaction time. Both steer to a lateral speed away.

Behind. Nobody stays nearer than CLOSE_S behind the one ahead, or goes on in contact with it: that, too, is a conflict,
with a required deceleration just above the threshold.
"""

import math

import numpy as np

from policies.exactmath import sincos
from policies.jit import kernel
from service.world import agents as A
from service.world.sim import minds as M

BEHIND_M, AHEAD_M = -30.0, 80.0  # along the road: who is looked at
IN_PATH_M = 0.3  # lateral room below which a vehicle is in the path
LOOK_AHEAD_S = 2.8  # cut-ins are foreseen so long
LEAST_ACROSS_MPS = 0.2  # lateral closing speed that is noticed
LEAST_CLOSING_MPS = 0.5
MARGIN_M = 1.0  # left between the bumpers when the braking ends
FAR_S = 8.0  # time to collision beyond which nobody brakes
BRAKE_GAIN, BRAKE_EXTRA_MPS2 = 1.25, 0.5  # of the deceleration aimed at, over the one required
LEADER_BRAKES_MPS2 = 0.5  # a leader's deceleration that counts
CLOSE_S, CLOSE_OPENS_MPS = 0.25, 0.5  # time headway that is too short, unless the gap opens this fast
CLOSE_NEEDS = 1.01  # times the threshold of the required deceleration: what a gap too short requires
QUICKEST = 2.0  # how much faster the clock runs at most
SIDE_S = 2.5
OWN_REACTION_S = 0.1  # who changes lanes is looking
SIDE_REACTION = 2.0 / 3.0  # of the reaction time, for a conflict beside
ROOM_GAP_M, ROOM_CLOSING_S = 2.0, 0.4  # as gap_m and gap_closing_s, of who is moved upon
NARROW_M = 0.3  # room beside that is too little, ...
PARTING_MPS = 0.1  # ... unless it grows this fast
BACK_MPS, ROOM_MPS = 0.4, 0.3  # lateral speed away: giving up a lane change, making room
TURN_S = 0.5  # in which the heading for it is reached
HOME_M = 0.4  # from a lane's middle: who gave up a lane change is back
BUSY_OFFSET_M = 0.9  # from a lane's middle: the wheels are on a marking
SIDE_ACCELERATION_MPS2 = 4.0
SLOWEST_MPS = 3.0

# columns of what a driver sees of the others, and where a threshold of the scenario's table lies among `traits`
STATION_M, OFFSET_M, SPEED_MPS, ACROSS_MPS, ACCELERATION_MPS2 = range(5)
SEEN = 5
TTC_S, REQUIRED_MPS2, HARDEST_MPS2, JERK_MPS3, GAP_M, GAP_CLOSING_S = range(6)
TRAITS = 6


@kernel
def conflicts(
    agents: np.ndarray, count: int, seen: np.ndarray, i: int, traits: np.ndarray
) -> tuple[float, float, float, float]:
    """What vehicle i perceives of the first `count` rows, whose columns `seen` (count, SEEN) has.

    Returns the deceleration required ahead (m/s^2), the shortest time to collision of a conflict ahead (s; inf:
    none), and the lateral direction away (-1 right, 1 left, 0 none) of its own lane change's conflict and of one who
    moves upon it.
    """
    me = agents[i]
    mine = seen[i]
    required, ttc, own, others = 0.0, math.inf, 0.0, 0.0
    for j in range(count):
        if j == i or agents[j, A.ACTIVE] == 0.0:
            continue
        you = seen[j]
        along = you[STATION_M] - mine[STATION_M]
        if along < BEHIND_M or along > AHEAD_M:
            continue
        across = you[OFFSET_M] - mine[OFFSET_M]
        gap = abs(along) - 0.5 * (me[A.LENGTH_M] + agents[j, A.LENGTH_M])
        room = abs(across) - 0.5 * (me[A.WIDTH_M] + agents[j, A.WIDTH_M])
        side = 1.0 if across > 0.0 else -1.0
        approach = side * (mine[ACROSS_MPS] - you[ACROSS_MPS])
        towards = side * mine[ACROSS_MPS]
        closing = mine[SPEED_MPS] - you[SPEED_MPS]
        if along > 0.0 and gap > 0.0:
            arrival = gap / closing if closing > 0.0 else math.inf
            in_path = room < IN_PATH_M or (
                approach > LEAST_ACROSS_MPS and room < approach * min(arrival + 0.3, LOOK_AHEAD_S)
            )
            left = max(gap - MARGIN_M, 0.1)
            need = closing * closing / (2.0 * left) if closing > 0.0 else 0.0
            if room < IN_PATH_M and you[ACCELERATION_MPS2] < -LEADER_BRAKES_MPS2:
                stop = you[SPEED_MPS] * you[SPEED_MPS] / (-2.0 * you[ACCELERATION_MPS2])
                need = max(need, mine[SPEED_MPS] * mine[SPEED_MPS] / (2.0 * (left + stop)))
            if room < 0.0 and gap < CLOSE_S * mine[SPEED_MPS] and closing > -CLOSE_OPENS_MPS:
                need = max(need, CLOSE_NEEDS * traits[REQUIRED_MPS2])
            if in_path and (closing > 0.0 or need > traits[REQUIRED_MPS2]):
                if (arrival < traits[TTC_S] and closing > LEAST_CLOSING_MPS) or need > traits[REQUIRED_MPS2]:
                    ttc = min(ttc, min(arrival, traits[TTC_S]))
                if need > required and (arrival < FAR_S or need > traits[REQUIRED_MPS2]):
                    required = need
        elif along > 0.0 and room < 0.0:  # boxes that overlap: the one behind falls back
            required, ttc = max(required, CLOSE_NEEDS * traits[REQUIRED_MPS2]), min(ttc, traits[TTC_S])
        nearing = max(0.0, closing if along > 0.0 else -closing)
        beside = gap < ROOM_GAP_M + ROOM_CLOSING_S * nearing
        if approach <= LEAST_ACROSS_MPS * 0.5 or room >= approach * SIDE_S:
            if beside and -0.1 < room < NARROW_M and approach > -PARTING_MPS:
                others -= side
            continue
        if towards > 0.1:
            if gap < traits[GAP_M] + traits[GAP_CLOSING_S] * nearing and room > -0.6:
                own -= side * max(towards, 0.3)
        elif beside and room > -0.1 and (approach > 0.15 or room < NARROW_M):
            others -= side
    return required, ttc, own, others


@kernel
def respond(
    agent: np.ndarray, mind: np.ndarray, found: tuple[float, float, float, float], traits: np.ndarray, dt_s: float,
    acceleration_mps2: float, turn_rate_radps: float,
) -> tuple[float, float]:  # fmt: skip
    """The action of a driver who looks, from the one it would have taken and the conflicts that it perceives.

    Updates its row of `service.world.sim.minds`.
    """
    required, ttc, own, others = found
    mind[M.EVADED] = 0.0
    if ttc < math.inf or (mind[M.BRAKE_MPS2] > 0.0 and required > 0.2):
        urgency = min(max(traits[TTC_S] / max(ttc, 0.01), 1.0), QUICKEST) if ttc < math.inf else 1.0
        mind[M.HAZARD_S] += urgency * dt_s
        if mind[M.HAZARD_S] >= mind[M.REACTION_S]:
            aim = min(traits[HARDEST_MPS2], BRAKE_GAIN * required + BRAKE_EXTRA_MPS2)
            begun = max(mind[M.BRAKE_MPS2], -acceleration_mps2, 0.0)
            mind[M.BRAKE_MPS2] = min(aim, begun + traits[JERK_MPS3] * dt_s)
            if -mind[M.BRAKE_MPS2] < acceleration_mps2:
                acceleration_mps2 = -mind[M.BRAKE_MPS2]
                mind[M.EVADED] = 1.0
    else:
        mind[M.HAZARD_S] = max(0.0, mind[M.HAZARD_S] - dt_s)
        mind[M.BRAKE_MPS2] = 0.0
    away, wanted = 0.0, 0.0
    if own == 0.0 and others == 0.0:
        mind[M.SIDE_S] = max(0.0, mind[M.SIDE_S] - dt_s)
    else:
        mind[M.SIDE_S] += dt_s
        if mind[M.SIDE_S] >= (OWN_REACTION_S if own != 0.0 else SIDE_REACTION * mind[M.REACTION_S]):
            away = own if own != 0.0 else others
            wanted = BACK_MPS if own != 0.0 else ROOM_MPS
    if away != 0.0:
        mind[M.EVADED] = 1.0
        away = 1.0 if away > 0.0 else -1.0
        if own != 0.0:
            mind[M.GIVEN_UP] = away
    elif mind[M.GIVEN_UP] != 0.0:
        away, wanted = mind[M.GIVEN_UP], BACK_MPS
    if mind[M.GIVEN_UP] != 0.0 and abs(agent[A.LANE_OFFSET_M]) < HOME_M:
        mind[M.GIVEN_UP] = 0.0
    if away == 0.0:
        return acceleration_mps2, turn_rate_radps
    speed = max(agent[A.SPEED_MPS], SLOWEST_MPS)
    follow = agent[A.CURVATURE_PER_M] * agent[A.SPEED_MPS]
    turn = (away * wanted / speed - agent[A.LANE_HEADING_RAD]) / TURN_S
    sharpest = SIDE_ACCELERATION_MPS2 / speed
    return acceleration_mps2, follow + min(max(turn, -sharpest), sharpest)


@kernel
def foreseen(
    agents: np.ndarray, count: int, seen: np.ndarray, i: int, traits: np.ndarray, seconds: float, held_mps2: float
) -> bool:  # fmt: skip
    """Whether vehicle i would be in conflict after a glance of so many seconds: with one ahead in its path, or with one
    that it would have moved upon.

    At all present speeds, its own acceleration held where it is above 0.
    """
    gain = max(held_mps2, 0.0) * seconds
    for j in range(count):
        along = seen[j, STATION_M] - seen[i, STATION_M]
        if j == i or agents[j, A.ACTIVE] == 0.0 or along < BEHIND_M or along > AHEAD_M:
            continue
        across = seen[j, OFFSET_M] - seen[i, OFFSET_M]
        side = 1.0 if across > 0.0 else -1.0
        approach = side * (seen[i, ACROSS_MPS] - seen[j, ACROSS_MPS])
        room = abs(across) - 0.5 * (agents[i, A.WIDTH_M] + agents[j, A.WIDTH_M])
        drift = approach * seconds if approach > 0.5 * LEAST_ACROSS_MPS else 0.0
        if room - drift >= IN_PATH_M:
            continue
        closing = seen[i, SPEED_MPS] - seen[j, SPEED_MPS]
        gap = abs(along) - 0.5 * (agents[i, A.LENGTH_M] + agents[j, A.LENGTH_M])
        if drift > 0.0 and gap - max(closing if along > 0.0 else -closing, 0.0) * seconds < ROOM_GAP_M:
            return True
        if along <= 0.0 or closing + gain <= LEAST_CLOSING_MPS:
            continue
        if gap - (closing + 0.5 * gain) * seconds < traits[TTC_S] * (closing + gain):
            return True
    return False


@kernel
def in_conflict(agent: np.ndarray, mind: np.ndarray, busy_mps: float) -> bool:
    """Whether nobody would look away now: a conflict is perceived, the wheels are on a marking, a lane change has been
    given up, or the vehicle moves across at `busy_mps` or more."""
    if mind[M.GIVEN_UP] != 0.0 or abs(agent[A.LANE_OFFSET_M]) > BUSY_OFFSET_M:
        return True
    sine, _ = sincos(agent[A.LANE_HEADING_RAD])
    return mind[M.HAZARD_S] > 0.0 or mind[M.SIDE_S] > 0.0 or abs(agent[A.SPEED_MPS] * sine) > busy_mps
