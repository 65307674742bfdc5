"""Tails of what vehicles do, recorded or driven by a model: shares of time in which they come near, and gaps accepted.

Motion is smoothed as the recordings are (`measures.resmoothed`), ends of a window are left out. A vehicle's leader is
the one ahead of it in its lane; one beside it overlaps it along the road and not across.
"""

from functools import partial
from typing import Any

import numpy as np

from policies.data.neighbours import leader_of
from policies.data.scenes import EDGE_FRAMES, Scene
from policies.realism.lane_changes import crossings, gap, neighbour
from policies.realism.measures import MOVING_MPS
from policies.realism.statistics import rate, rounded, vehicle_bootstrap

# name -> what is said of it; shares of frames, then quantities of each lane change
SHARES = {
    "headway_below_0.5_s": "time headway below 0.5 s (bumper to bumper)",
    "ttc_below_1_s": "time to collision with the leader below 1 s",
    "ttc_below_1.5_s": "time to collision with the leader below 1.5 s",
    "ttc_below_2_s": "time to collision with the leader below 2 s",
    "ttc_below_3_s": "time to collision with the leader below 3 s",
    "side_below_0.5_m": "less than 0.5 m from one beside",
    "braking_beyond_2_mps2": "deceleration beyond 2 m/s²",
    "braking_beyond_3_mps2": "deceleration beyond 3 m/s²",
    "braking_beyond_4_mps2": "deceleration beyond 4 m/s²",
    "driven_into_from_behind": "in contact with one behind that replays, which does not react",
    "in_other_contact": "in any other contact",
}
GAPS = {
    "lead_gap_m": "gap to the new leader, m",
    "lag_gap_m": "gap of the new follower, m",
}
HEADWAY_S, SIDE_M = 0.5, 0.5
TTC_S = (1.0, 1.5, 2.0, 3.0)
BRAKING_MPS2 = (2.0, 3.0, 4.0)


def tails(scene: Scene, who: np.ndarray, driven: np.ndarray) -> np.ndarray:
    """Frames (n, 1 + len(SHARES)) of columns `who` (n,): all, then those of each of SHARES.

    driven: columns that a model drives, who react to others
    """
    rows = np.arange(EDGE_FRAMES, len(scene.frame) - EDGE_FRAMES - 1)
    found = np.zeros((len(who), 1 + len(SHARES)))
    for i, v in enumerate(who):
        lead = leader_of(scene, int(v))[rows]
        ahead = np.maximum(lead, 0)
        half = 0.5 * (scene.length_m[ahead] + scene.length_m[v])
        gap_m = np.where(lead >= 0, scene.station[rows, ahead] - scene.station[rows, v] - half, np.inf)
        speed, accel = scene.speed[rows, v], scene.accel[rows, v]
        closing = speed - scene.speed[rows, ahead]
        with np.errstate(divide="ignore", invalid="ignore"):
            headway = np.where(speed > MOVING_MPS, gap_m / speed, np.inf)
            ttc = np.where((closing > 0.0) & (gap_m > 0.0), gap_m / closing, np.inf)
        near, behind, other = _beside(scene, rows, int(v), driven)
        columns = [headway < HEADWAY_S]
        columns += [ttc < limit for limit in TTC_S]
        columns += [near]
        columns += [accel < -limit for limit in BRAKING_MPS2]
        columns += [behind, other]
        there = scene.present[rows, v]
        found[i] = [there.sum(), *((column & there).sum() for column in columns)]
    return found


def _beside(
    scene: Scene, rows: np.ndarray, v: int, driven: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Rows in which column v is nearer than SIDE_M to one beside, in contact with a replayed one behind, in another
    contact."""
    along = scene.station[rows] - scene.station[rows, v : v + 1]
    across = np.abs(scene.lateral[rows] - scene.lateral[rows, v : v + 1])
    meets = (np.abs(along) < 0.5 * (scene.length_m + scene.length_m[v])) & scene.present[rows]
    meets[:, v] = False
    room = across - 0.5 * (scene.width_m + scene.width_m[v])
    touching = meets & (room < 0.0)
    replays = np.ones(along.shape[1], dtype=bool)
    replays[driven] = False
    behind = touching & (along < 0.0) & replays
    return (
        (meets & (room >= 0.0) & (room < SIDE_M)).any(axis=1),
        behind.any(axis=1),
        (touching & ~behind).any(axis=1),
    )


def gaps(scene: Scene, who: np.ndarray) -> list[tuple[int, float, float]]:
    """(vehicle, gap to the new leader, gap of the new follower) of each lane change of columns `who`, in m; NaN where
    there is nobody."""
    found = []
    for v in (int(v) for v in who):
        for k in crossings(scene.lane[:, v], scene.dt_s):
            lane = int(scene.lane[k, v])
            lead, lag = (neighbour(scene, k, v, lane, ahead=ahead) for ahead in (True, False))
            before = gap(scene, k, v, lead)[0] if lead >= 0 else np.nan
            behind = gap(scene, k, lag, v)[0] if lag >= 0 else np.nan
            found.append((int(scene.vehicle_id[v]), before, behind))
    return found


def tail_facts(
    frames: np.ndarray,
    vehicle: np.ndarray,
    accepted: list[tuple[int, float, float]],
    rng: np.random.Generator,
) -> dict:
    """SHARES with intervals over vehicles; of GAPS how many, the median with its interval, and the smallest.

    frames: (n, 1 + len(SHARES)) of `tails`; vehicle: (n,)
    """
    told = {name: rate(frames[:, 1 + k], frames[:, 0], vehicle, rng) for k, name in enumerate(SHARES)}
    table = np.array(accepted, dtype=float).reshape(len(accepted), 3)
    of_each: dict[str, dict[str, Any]] = {}
    for k, name in enumerate(GAPS):
        good = np.isfinite(table[:, 1 + k])
        values, of = table[good, 1 + k], table[good, 0].astype(np.int64)
        of_each[name] = {"n": len(values), "median": None, "median_interval_95": None, "smallest": None}
        if len(values):
            interval = vehicle_bootstrap(of, partial(_median, values), rng)
            of_each[name] |= {
                "median": rounded(float(np.median(values)), 2),
                "median_interval_95": [rounded(x, 2) for x in interval],
                "smallest": rounded(float(values.min()), 2),
            }
    return {"shares": told, "gaps": of_each}


def _median(values: np.ndarray, weight: np.ndarray) -> float:
    if weight.sum() <= 0.0:
        return float("nan")
    order = np.argsort(values)
    below = np.cumsum(weight[order])
    return float(values[order][np.searchsorted(below, 0.5 * below[-1])])
