"""What of a state bears on danger: numbers on the ego and each other vehicle, to learn a committor from.

Signs are turned so that the ego's left and right are alike: a lateral quantity is positive towards each other, and each
feature is about 1 in size in motorway traffic and cut off at LIMIT. They are a function of the state alone; nothing in
them is of what is still to be drawn. A vehicle that has left the road has FAR_ASIDE and zeros.

What a driver means to do next is what its network answers to what it sees, which the drawn weights xi decide: copies of
a path share them. At the start it is 0, as starts are chosen before their weights are drawn.
"""

import math

import numpy as np

from policies.egos.compiled import act
from policies.exactmath import log, sincos
from policies.jit import kernel
from policies.layout import OUTPUTS
from policies.network import forward, sample_action
from service.world import agents as A
from service.world.paths.level import level_of
from service.world.paths.nearest import FARTHEST, nearest
from service.world.paths.states import BEFORE, LAST, States
from service.world.sim import minds as M

LIMIT = 6.0
FAR_ASIDE = 6.0
TYPICAL_SPEED_MPS = 16.0
LEAST_SPEED_DIFFERENCE_MPS = 0.3
SIDE = 0.5, 5.5  # metres to the side at which a third vehicle stands in the way

# of the vehicle relative to the ego
(
    ALONG, CLOSING, ASIDE, APPROACH, ITS_HEADING, EGO_HEADING, EGO_SPEED, ITS_SPEED, ITS_OFFSET, EGO_OFFSET,
    ITS_ACCELERATION, EGO_ACCELERATION, ITS_TURN, EGO_TURN, TAKEN_OVER, LEFT, EARLY, TIME, TO_ALONGSIDE, GAP_THEN,
    LOG_DIFFERENCE, LOG_PASSING, LEVEL, TO_REACH, ROOM_THEN, ROOM_ALONG, REQUIRED,
) = range(27)  # fmt: skip
FAR_SIDE, NEAR_SIDE = 27, 30  # a third vehicle beside it: distance along, speed difference, distance across
# of the driver
(
    AWAY, AWAY_FOR, REACTION, HAZARD, BESIDE, BRAKING, HELD, NOISE_A, NOISE_W, DRIFT_A, DRIFT_W, SINCE,
) = range(33, 45)  # fmt: skip
# `nearest` to the ego as both move, as both brake, and to that other vehicle to which it comes nearest
NEAREST, NEAREST_BRAKING, NEAREST_THIRD = 45, 49, 53
ITS_NEXT_ACCELERATION, ITS_NEXT_TURN, ITS_SPREAD, ITS_TURN_SPREAD, EGO_NEXT_ACCELERATION, EGO_NEXT_TURN = (
    range(57, 63)
)
FEATURES = 63


@kernel
def _cut(value: float) -> float:
    return min(max(value, -LIMIT), LIMIT)


@kernel
def _fill(
    agents: np.ndarray, minds: np.ndarray, noise: np.ndarray, at: int, ego: int, spacing_m: float, dt_s: float,
    out: np.ndarray, along: np.ndarray, across_mps: np.ndarray,
) -> None:  # fmt: skip
    """Fill `out` (others, FEATURES); along, across_mps: (vehicles,), room for the work."""
    vehicles = agents.shape[0]
    for i in range(vehicles):
        sine, _ = sincos(agents[i, A.LANE_HEADING_RAD])
        along[i] = agents[i, A.STATION] * spacing_m + agents[i, A.ALONG_M]
        across_mps[i] = agents[i, A.SPEED_MPS] * sine
    me = agents[ego]
    time_s = at * dt_s
    row = 0
    for j in range(vehicles):
        if j == ego:
            continue
        you, f = agents[j], out[row]
        row += 1
        f[:] = 0.0
        if you[A.ACTIVE] == 0.0:
            f[ASIDE] = FAR_ASIDE
            continue
        ds = along[j] - along[ego]
        dl = you[A.OFFSET_M] - me[A.OFFSET_M]
        side = 1.0 if dl >= 0.0 else -1.0
        dv = you[A.SPEED_MPS] - me[A.SPEED_MPS]
        aside = abs(dl)
        approach = -(across_mps[j] - across_mps[ego]) * side
        least = LEAST_SPEED_DIFFERENCE_MPS
        difference = dv if abs(dv) >= least else (least if dv >= 0.0 else -least)
        alongside_s = min(max(-ds / difference, -3.0), 8.0)
        gap_then = min(max(aside - approach * min(max(alongside_s, 0.0), 4.0), -3.0), 10.0)
        gap = abs(ds) - 0.5 * (me[A.LENGTH_M] + you[A.LENGTH_M])
        room = aside - 0.5 * (me[A.WIDTH_M] + you[A.WIDTH_M])
        closing = -dv if ds > 0.0 else dv
        reach_s = min(max(gap, 0.0) / max(closing, 0.3), 8.0)
        level = level_of(gap, room, closing)
        required = (
            closing * closing / (2.0 * max(gap, 0.5)) if room < 0.3 and closing > 0.0 and gap > 0.0 else 0.0
        )
        f[ALONG] = _cut(ds / 10.0)
        f[CLOSING] = _cut(dv / 4.0)
        f[ASIDE] = _cut(aside / 2.0 - 1.0)
        f[APPROACH] = _cut(approach * 2.0)
        f[ITS_HEADING] = _cut(-you[A.LANE_HEADING_RAD] * side * 40.0)
        f[EGO_HEADING] = _cut(me[A.LANE_HEADING_RAD] * side * 40.0)
        f[EGO_SPEED] = _cut((me[A.SPEED_MPS] - TYPICAL_SPEED_MPS) / 3.0)
        f[ITS_SPEED] = _cut((you[A.SPEED_MPS] - TYPICAL_SPEED_MPS) / 3.0)
        f[ITS_OFFSET] = _cut(-you[A.LANE_OFFSET_M] * side * 2.0)
        f[EGO_OFFSET] = _cut(me[A.LANE_OFFSET_M] * side * 2.0)
        f[ITS_ACCELERATION] = _cut(you[A.ACCELERATION_MPS2] / 2.0)
        f[EGO_ACCELERATION] = _cut(me[A.ACCELERATION_MPS2] / 2.0)
        f[ITS_TURN] = _cut(-you[A.TURN_RATE_RADPS] * side * 30.0)
        f[EGO_TURN] = _cut(me[A.TURN_RATE_RADPS] * side * 30.0)
        f[TAKEN_OVER] = you[A.TAKEN_OVER]
        f[LEFT] = side
        f[EARLY] = min(time_s, 1.5) / 0.75 - 1.0
        f[TIME] = _cut(time_s / 5.0 - 1.0)
        f[TO_ALONGSIDE] = alongside_s / 3.0
        f[GAP_THEN] = gap_then - 2.2
        f[LOG_DIFFERENCE] = _cut(log(abs(difference)) - 1.0)
        passing = log(2.0 * max(gap_then - 0.9, 0.15) / abs(difference))
        f[LOG_PASSING] = min(max(passing, -3.0), 3.0)
        f[LEVEL] = log(level + 0.15)
        f[TO_REACH] = reach_s / 3.0 - 1.0
        f[ROOM_THEN] = min(max(room - approach * min(reach_s, 3.0), -2.0), 4.0)
        f[ROOM_ALONG] = min(max(gap, -5.0), 10.0) / 4.0
        f[REQUIRED] = min(required, 9.0) / 3.0
        for which in range(2):
            towards = side if which == 0 else -side
            best, nearest = -1, math.inf
            for k in range(vehicles):
                if k in (ego, j) or agents[k, A.ACTIVE] == 0.0:
                    continue
                beside = (agents[k, A.OFFSET_M] - you[A.OFFSET_M]) * towards
                if beside <= SIDE[0] or beside >= SIDE[1]:
                    continue
                cost = abs(along[k] - along[j]) / 3.0 + beside
                if cost < nearest:
                    best, nearest = k, cost
            first = FAR_SIDE if which == 0 else NEAR_SIDE
            if best < 0:
                f[first], f[first + 1], f[first + 2] = 4.0, 0.0, 2.0
            else:
                third = agents[best]
                f[first] = min(max((along[best] - along[j]) / 10.0, -4.0), 4.0)
                f[first + 1] = _cut((third[A.SPEED_MPS] - you[A.SPEED_MPS]) / 4.0)
                f[first + 2] = (third[A.OFFSET_M] - you[A.OFFSET_M]) * towards / 2.0 - 1.5
        if minds.shape[0] > 0:
            mind = minds[j]
            f[AWAY] = 1.0 if mind[M.AWAY_S] > 0.0 else 0.0
            f[AWAY_FOR] = min(mind[M.AWAY_S], 4.0)
            f[REACTION] = _cut(log(max(mind[M.REACTION_S], 1e-3) / 0.9) / 0.35)
            f[HAZARD] = _cut(mind[M.HAZARD_S])
            f[BESIDE] = _cut(mind[M.SIDE_S])
            f[BRAKING] = _cut(mind[M.BRAKE_MPS2] / 3.0)
            f[HELD] = _cut(mind[M.HELD_MPS2] / 2.0)
            f[NOISE_A] = _cut(noise[j, LAST])
            f[NOISE_W] = _cut(-noise[j, LAST + 1] * side)
            f[DRIFT_A] = _cut((noise[j, LAST] - noise[j, BEFORE]) * 5.0)
            f[DRIFT_W] = _cut(-(noise[j, LAST + 1] - noise[j, BEFORE + 1]) * side * 5.0)
            f[SINCE] = min(mind[M.SINCE_AWAY_S], 3.0) / 1.5 - 1.0


@kernel
def _between(
    one: np.ndarray, other: np.ndarray, along_m: float, across_mps: float, braking: bool
) -> tuple[float, float, float, float]:  # fmt: skip
    """`nearest` of two vehicles.

    along_m: distance; across_mps: difference of the speeds across
    """
    return nearest(
        along_m, other[A.OFFSET_M] - one[A.OFFSET_M], other[A.SPEED_MPS] - one[A.SPEED_MPS], across_mps,
        other[A.ACCELERATION_MPS2] - one[A.ACCELERATION_MPS2] if braking else 0.0,
        0.5 * (one[A.LENGTH_M] + other[A.LENGTH_M]), 0.5 * (one[A.WIDTH_M] + other[A.WIDTH_M]),
    )  # fmt: skip


@kernel
def _put(found: tuple[float, float, float, float], first: int, f: np.ndarray) -> None:
    f[first] = found[0]
    f[first + 1] = found[1]
    f[first + 2] = min(found[2], 10.0) / 3.0
    f[first + 3] = min(found[3], 4.0)


@kernel
def _fill_nearest(
    agents: np.ndarray, ego: int, along: np.ndarray, across_mps: np.ndarray, out: np.ndarray
) -> None:
    """Fill the columns from NEAREST on."""
    vehicles, row = agents.shape[0], 0
    for j in range(vehicles):
        if j == ego:
            continue
        f = out[row]
        row += 1
        for c in range(NEAREST, ITS_NEXT_ACCELERATION):
            f[c] = FARTHEST
        if agents[j, A.ACTIVE] == 0.0:
            continue
        far, across = along[j] - along[ego], across_mps[j] - across_mps[ego]
        _put(_between(agents[ego], agents[j], far, across, False), NEAREST, f)
        _put(_between(agents[ego], agents[j], far, across, True), NEAREST_BRAKING, f)
        least = math.inf
        for k in range(vehicles):
            if k in (ego, j) or agents[k, A.ACTIVE] == 0.0:
                continue
            found = _between(agents[k], agents[j], along[j] - along[k], across_mps[j] - across_mps[k], False)
            if found[0] < least:
                least = found[0]
                _put(found, NEAREST_THIRD, f)


@kernel
def _fill_next(
    agents: np.ndarray, observations: np.ndarray, head: np.ndarray, at: int, ego: int, own: tuple, network: tuple,
    answers: np.ndarray, out: np.ndarray,
) -> None:  # fmt: skip
    """Fill the columns of what the drivers mean to do next.

    own: kind and weights of the ego; network: w1, b1, w2, b2 and scale of the drivers; answers: (4,), room for the work
    """
    kind, ew1, eb1, ew2, eb2, ehead, escale = own
    w1, b1, w2, b2, scale = network
    ego_a, ego_w = act(kind, observations[ego], ew1, eb1, ew2, eb2, ehead, escale, answers)
    if not (math.isfinite(ego_a) and math.isfinite(ego_w)):
        ego_a, ego_w = 0.0, 0.0
    row = 0
    for j in range(agents.shape[0]):
        if j == ego:
            continue
        f = out[row]
        row += 1
        for c in range(ITS_NEXT_ACCELERATION, FEATURES):
            f[c] = 0.0
        if agents[j, A.ACTIVE] == 0.0:
            continue
        side = 1.0 if agents[j, A.OFFSET_M] >= agents[ego, A.OFFSET_M] else -1.0
        f[EGO_NEXT_ACCELERATION] = _cut(ego_a / 2.0)
        f[EGO_NEXT_TURN] = _cut(ego_w * side * 30.0)
        if at > 0:
            forward(observations[j], w1, b1, w2, b2, head, answers)
            a, w = sample_action(answers, scale, 0.0, 0.0)
            f[ITS_NEXT_ACCELERATION] = _cut(a / 2.0)
            f[ITS_NEXT_TURN] = _cut(-w * side * 30.0)
            f[ITS_SPREAD] = min(max(np.float64(answers[2]), -LIMIT), LIMIT)
            f[ITS_TURN_SPREAD] = min(max(np.float64(answers[3]), -LIMIT), LIMIT)


@kernel
def _fill_all(
    agents: np.ndarray, observations: np.ndarray, minds: np.ndarray, noise: np.ndarray, heads: np.ndarray,
    at: np.ndarray, ego: int, own: tuple, network: tuple, spacing_m: float, dt_s: float, out: np.ndarray,
) -> None:  # fmt: skip
    along, across_mps = np.empty(agents.shape[1]), np.empty(agents.shape[1])
    one, answers = np.empty((out.shape[1], out.shape[2])), np.empty(OUTPUTS, np.float32)
    for r in range(at.size):
        _fill(agents[r], minds[r], noise[r], at[r], ego, spacing_m, dt_s, one, along, across_mps)
        _fill_nearest(agents[r], ego, along, across_mps, one)
        _fill_next(agents[r], observations[r], heads[r], at[r], ego, own, network, answers, one)
        out[r] = one


def features_of(
    states: States, ego: int, own: tuple, network: tuple, spacing_m: float, dt_s: float
) -> np.ndarray:
    """(n, other vehicles, FEATURES) float32.

    ego: its row
    own: kind and weights of the ego; network: w1, b1, w2, b2 and scale of the drivers
    """
    s = states
    out = np.empty((len(s), s.agents.shape[1] - 1, FEATURES), np.float32)
    _fill_all(
        s.agents, s.observations, s.minds, s.noise, s.heads, s.at, ego, own, network, spacing_m, dt_s, out
    )
    return out
