"""What the rates write down of one moment: kilometres, contacts and near-crashes among the environment vehicles.

What is remembered from one moment to the next (`Memory`) can be copied, so that a rollout may go on in two ways from
a moment (`service.studies.human.leaks`).
"""

import math
from typing import NamedTuple

import numpy as np

from policies.jit import kernel
from service.world import agents as A
from service.world.safety.boxes import time_until_touch
from service.world.sim import minds as M
from service.world.sim.collision import overlap

EARLY_S = 10.0  # what happens before is told apart
NEAR_TTC_S = 1.5  # time until the boxes touch, with evasion: a near-crash
NEAR_REQUIRED_MPS2 = 0.5 * 9.80665  # or a deceleration required above this
EVASIVE_MPS2 = 3.0  # a rapid evasion: braking harder than this, ...
EVASIVE_ACROSS_MPS2 = 2.0  # ... or an evasive turn with this much lateral acceleration
APART_S = 2.0  # dangers of a pair less than this apart are one
SAME_LANE_S = 3.0  # in each other's path this long before a contact: a rear-end, not a cut-in
RECENT_S = 1.5  # a glance this short a time before a contact had to do with it
FARTHEST_M = 60.0  # along the road: pairs further apart are not looked at
REAR_END, CUT_IN, SIDE, NEAR_CRASH = range(4)
KINDS = ("rear-end", "cut-in", "side")  # of contacts

# columns of an event: a contact, or a near-crash, whose CAUSE is 0 by time to touch and 1 by deceleration. LEAKED and
# RESISTED: glances of all drivers until then that began, and that were suppressed, in a conflict. WEIGHT: how many such
# events it stands for; -1 takes back a near-crash that became a contact.
(
    TIME_S, FIRST, SECOND, KIND, DELTA_V_MPS, LOOKED_AWAY, LONGEST_AWAY_S, CAUSE, AGAIN, LEAKED, RESISTED, WEIGHT
) = range(12)  # fmt: skip
EVENT = 12
# of the tallies (2, TALLIES): before EARLY_S and after
KM, EVADING_S = range(2)
TALLIES = 2
# what is remembered of a pair: whether it has been in contact, when a danger was last seen, the cause and the time of
# the near-crash that was counted last (cause -1: none), seconds that it has overlapped across the road
TOUCHED, SEEN_S, CAUSED, COUNTED_S, IN_PATH_S = range(5)
OF_A_PAIR = 5


class Memory(NamedTuple):
    """What is remembered of n vehicles from one moment to the next.

    pairs: (n, n, OF_A_PAIR), i < j
    hurt: (n,), 1 once a vehicle has been in contact with any
    history: (moments, n), offsets in m of the last SAME_LANE_S
    """

    pairs: np.ndarray
    hurt: np.ndarray
    history: np.ndarray

    def copy(self) -> "Memory":
        return Memory(self.pairs.copy(), self.hurt.copy(), self.history.copy())


def nothing_yet(n: int, dt_s: float) -> Memory:
    """The memory of n vehicles before the first moment."""
    pairs = np.zeros((n, n, OF_A_PAIR))
    pairs[:, :, SEEN_S] = -math.inf
    pairs[:, :, CAUSED] = -1.0
    return Memory(pairs, np.zeros(n), np.zeros((int(SAME_LANE_S / dt_s) + 1, n)))


@kernel
def _note(e: np.ndarray, t: float, rear: int, front: int, kind: int, minds: np.ndarray) -> None:
    e[:] = 0.0
    e[TIME_S], e[FIRST], e[SECOND], e[KIND], e[WEIGHT] = t, rear, front, kind, 1.0
    for q in range(minds.shape[0]):
        e[LEAKED] += minds[q, M.LEAKED]
        e[RESISTED] += minds[q, M.RESISTED]


@kernel
def _evades(g: np.ndarray, mind: np.ndarray) -> bool:
    turn = (g[A.TURN_RATE_RADPS] - g[A.CURVATURE_PER_M] * g[A.SPEED_MPS]) * g[A.SPEED_MPS]
    steers = mind[M.EVADED] != 0.0 and abs(turn) > EVASIVE_ACROSS_MPS2
    return steers or g[A.ACCELERATION_MPS2] < -EVASIVE_MPS2


@kernel
def watch(
    agents: np.ndarray, minds: np.ndarray, n: int, ego: int, spacing_m: float, dt_s: float, k: int, pairs: np.ndarray,
    hurt: np.ndarray, history: np.ndarray, tallies: np.ndarray, events: np.ndarray, found: int,
) -> int:  # fmt: skip
    """Look at the state after k steps; add to `tallies` (2, TALLIES) and to the `found` rows of `events` (most, EVENT).

    pairs, hurt, history: a `Memory`'s, updated
    Returns how many rows there are then; those for which `events` has no room are left out.
    """
    t = k * dt_s
    part = 0 if t < EARLY_S else 1
    seen = np.zeros((n, 2))
    then = history[(k + 1) % history.shape[0]] if k + 1 >= history.shape[0] else history[0]
    for i in range(n):
        a = agents[i]
        seen[i, 0] = a[A.STATION] * spacing_m + a[A.ALONG_M]
        seen[i, 1] = a[A.OFFSET_M]
        history[k % history.shape[0], i] = a[A.OFFSET_M]
        if i != ego and a[A.ACTIVE] != 0.0 and a[A.TAKEN_OVER] == 0.0:
            tallies[part, KM] += a[A.SPEED_MPS] * dt_s / 1000.0
            if minds[i, M.EVADED] != 0.0:
                tallies[part, EVADING_S] += dt_s
    for i in range(n):
        for j in range(i + 1, n):
            a, b, pair = agents[i], agents[j], pairs[i, j]
            if i == ego or j == ego or a[A.ACTIVE] == 0.0 or b[A.ACTIVE] == 0.0:
                continue
            along, across = seen[j, 0] - seen[i, 0], seen[j, 1] - seen[i, 1]
            room = abs(across) - 0.5 * (a[A.WIDTH_M] + b[A.WIDTH_M])
            pair[IN_PATH_S] = pair[IN_PATH_S] + dt_s if room < 0.0 else 0.0
            if abs(along) > FARTHEST_M or pair[TOUCHED] != 0.0:
                continue
            rear, front = (i, j) if along >= 0.0 else (j, i)
            gap = abs(along) - 0.5 * (a[A.LENGTH_M] + b[A.LENGTH_M])
            if a[A.COLLISION] != 0.0 and b[A.COLLISION] != 0.0 and overlap(a, b):
                pair[TOUCHED] = 1.0
                if pair[CAUSED] >= 0.0 and pair[SEEN_S] > t - 2.0 * APART_S and found < events.shape[0]:
                    _note(events[found], pair[COUNTED_S], rear, front, NEAR_CRASH, minds)
                    events[found, CAUSE] = pair[CAUSED]
                    events[found, WEIGHT] = -1.0  # it was no near-crash
                    found += 1
                if found < events.shape[0]:
                    e = events[found]
                    found += 1
                    ux = a[A.SPEED_MPS] * a[A.COS] - b[A.SPEED_MPS] * b[A.COS]
                    uy = a[A.SPEED_MPS] * a[A.SIN] - b[A.SPEED_MPS] * b[A.SIN]
                    sign = 1.0 if across > 0.0 else -1.0
                    moved_i, moved_j = sign * (seen[i, 1] - then[i]), -sign * (seen[j, 1] - then[j])
                    if pair[IN_PATH_S] > SAME_LANE_S:
                        kind, cause = REAR_END, rear
                    else:
                        kind = CUT_IN if gap > -0.6 and room < -0.1 else SIDE
                        cause = i if moved_i > moved_j else j
                    _note(e, t, rear, front, kind, minds)
                    e[DELTA_V_MPS] = 0.5 * math.sqrt(ux * ux + uy * uy)
                    e[CAUSE] = cause
                    e[LOOKED_AWAY] = 1.0 if minds[cause, M.SINCE_AWAY_S] <= RECENT_S else 0.0
                    e[LONGEST_AWAY_S] = minds[cause, M.LONGEST_AWAY_S]
                    e[AGAIN] = max(hurt[i], hurt[j])
                continue
            if hurt[i] != 0.0 or hurt[j] != 0.0:
                continue
            closing = agents[rear, A.SPEED_MPS] - agents[front, A.SPEED_MPS]
            in_time = (_evades(a, minds[i]) or _evades(b, minds[j])) and time_until_touch(a, b) < NEAR_TTC_S
            braked = (
                room < 0.0
                and gap > 0.0
                and closing > 0.0
                and closing * closing / (2.0 * gap) > NEAR_REQUIRED_MPS2
            )
            if in_time or braked:
                if t - pair[SEEN_S] > APART_S and found < events.shape[0]:
                    pair[CAUSED], pair[COUNTED_S] = 0.0 if in_time else 1.0, t
                    _note(events[found], t, rear, front, NEAR_CRASH, minds)
                    events[found, CAUSE] = pair[CAUSED]
                    found += 1
                pair[SEEN_S] = t
    for i in range(n):
        if agents[i, A.COLLISION] != 0.0:
            hurt[i] = 1.0
    return found
