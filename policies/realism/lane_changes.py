"""Lane changes in a scene: when, from where, at which speed, how fast across, and what gaps they leave.

A lane change is a crossing of a lane boundary by the vehicle's centre with both lanes held for at least HELD_S (or
until the track ends). Its gaps are those in the new lane at the crossing, bumper to bumper; the vehicle behind is the
one that is cut in on. Duration and lateral speed are of the smoothed motion: from where the lateral speed rises above
STILL_MPS before the crossing to where it falls below it again.
"""

import itertools
from dataclasses import dataclass, fields

import numpy as np

from policies.columns import Columns
from policies.data.scenes import Scene
from policies.data.smoothing import DT_S

HELD_S = 1.0
STILL_MPS = 0.1  # lateral: slower is keeping the lane
WATCHED_S = 5.0  # after the crossing, for the smallest gaps


@dataclass(frozen=True)
class LaneChanges(Columns):
    """n lane changes, one row each; NaN where there is no such neighbour.

    scene: (n,), number of the scene
    vehicle: (n,), column
    frame: (n,), row of the crossing
    lane_from, lane_to: (n,), 0 = leftmost
    speed_mps: (n,), at the crossing
    duration_s: (n,)
    lateral_speed_mps: (n,), the largest
    lead_*, lag_*: (n,), of the vehicle ahead and behind in the new lane at the crossing: bumper gap (m, negative if
        side by side), speed difference (m/s, positive when closing), time headway (gap / speed of the one behind, s),
        time to collision (s, inf when not closing)
    lag_min_*: (n,), the smallest in WATCHED_S after the crossing while both stay in the lane
    """

    scene: np.ndarray
    vehicle: np.ndarray
    frame: np.ndarray
    lane_from: np.ndarray
    lane_to: np.ndarray
    speed_mps: np.ndarray
    duration_s: np.ndarray
    lateral_speed_mps: np.ndarray
    lead_gap_m: np.ndarray
    lead_closing_mps: np.ndarray
    lead_headway_s: np.ndarray
    lead_ttc_s: np.ndarray
    lag_gap_m: np.ndarray
    lag_closing_mps: np.ndarray
    lag_headway_s: np.ndarray
    lag_ttc_s: np.ndarray
    lag_min_headway_s: np.ndarray
    lag_min_ttc_s: np.ndarray


def lane_changes(scenes: list[Scene]) -> LaneChanges:
    """All lane changes of `scenes`."""
    rows = [
        (number, *row)
        for number, scene in enumerate(scenes)
        for v in range(len(scene.vehicle_id))
        for row in _of_vehicle(scene, v)
    ]
    table = np.array(rows, dtype=np.float64).reshape(len(rows), len(fields(LaneChanges)))
    columns = [table[:, i].astype(np.int64) if i < 5 else table[:, i] for i in range(table.shape[1])]
    return LaneChanges(*columns)


def crossings(lane: np.ndarray, dt_s: float = DT_S) -> list[int]:
    """First frames in the new lane of each lane change of one track; lane (F,), -1 where absent."""
    runs = _runs(lane)
    held = round(HELD_S / dt_s)
    found = []
    steady: tuple[int, int] | None = None  # (lane, last frame) of the last run that was held
    for start, stop, number in runs:
        if number < 0:
            steady = None
            continue
        at_edge = start == 0 or lane[start - 1] < 0 or stop == len(lane) or lane[stop] < 0
        if stop - start < held and not (at_edge and stop - start >= held // 2):
            continue
        if steady is not None and steady[0] != number:
            found.append(_last_entry(lane, start, steady[0]))
        steady = (number, stop)
    return found


def _last_entry(lane: np.ndarray, start: int, old: int) -> int:
    """Where the vehicle left `old` for good before `start`: short visits between do not move a crossing twice."""
    k = start
    while k > 0 and lane[k - 1] >= 0 and lane[k - 1] != old:
        k -= 1
    return k


def _runs(lane: np.ndarray) -> list[tuple[int, int, int]]:
    cuts = np.flatnonzero(np.diff(lane) != 0) + 1
    edges = np.concatenate([[0], cuts, [len(lane)]])
    return [(int(a), int(b), int(lane[a])) for a, b in itertools.pairwise(edges) if b > a]


def _of_vehicle(scene: Scene, v: int) -> list[tuple]:
    lane = scene.lane[:, v]
    sideways = np.gradient(scene.lateral[:, v], scene.dt_s)
    rows = []
    for k in crossings(lane, scene.dt_s):
        across = -np.sign(lane[k] - lane[k - 1]) * sideways  # positive towards the new lane
        first = k
        while first > 0 and across[first - 1] > STILL_MPS:
            first -= 1
        last = k
        while last + 1 < len(lane) and across[last + 1] > STILL_MPS:
            last += 1
        complete = np.isfinite(across[max(first - 1, 0)]) and np.isfinite(
            across[min(last + 1, len(lane) - 1)]
        )
        lead = neighbour(scene, k, v, int(lane[k]), ahead=True)
        lag = neighbour(scene, k, v, int(lane[k]), ahead=False)
        before = gap(scene, k, v, lead) if lead >= 0 else NONE
        behind = gap(scene, k, lag, v) if lag >= 0 else NONE
        rows.append(
            (
                v,
                k,
                lane[k - 1],
                lane[k],
                scene.speed[k, v],
                (last - first) * scene.dt_s if complete else np.nan,
                float(np.nanmax(across[first : last + 1])),
                *before,
                *behind,
                *_smallest(scene, k, v, lag),
            )
        )
    return rows


NONE = (np.nan, np.nan, np.nan, np.nan)


def neighbour(scene: Scene, k: int, v: int, lane: int, ahead: bool) -> int:
    """The nearest vehicle in `lane` by its centre, or -1."""
    distance = scene.station[k] - scene.station[k, v]
    there = (scene.lane[k] == lane) & ((distance > 0.0) if ahead else (distance < 0.0))
    there[v] = False
    if not there.any():
        return -1
    return int(np.flatnonzero(there)[np.abs(distance[there]).argmin()])


def gap(scene: Scene, k: int, behind: int, ahead: int) -> tuple[float, float, float, float]:
    """Bumper gap (m), closing speed (m/s), time headway (s) and time to collision (s) of `behind` to `ahead`."""
    half = 0.5 * (scene.length_m[ahead] + scene.length_m[behind])
    metres = scene.station[k, ahead] - scene.station[k, behind] - half
    closing = scene.speed[k, behind] - scene.speed[k, ahead]
    headway = metres / max(scene.speed[k, behind], 0.1)
    return float(metres), float(closing), float(headway), float(metres / closing if closing > 0.0 else np.inf)


def _smallest(scene: Scene, k: int, v: int, lag: int) -> tuple[float, float]:
    """Smallest time headway and time to collision of the vehicle cut in on, in WATCHED_S while both stay."""
    if lag < 0:
        return np.nan, np.nan
    headway, ttc = np.inf, np.inf
    for frame in range(k, min(k + round(WATCHED_S / scene.dt_s) + 1, len(scene.frame))):
        if scene.lane[frame, v] != scene.lane[k, v] or scene.lane[frame, lag] != scene.lane[k, v]:
            break
        _, _, h, t = gap(scene, frame, lag, v)
        headway, ttc = min(headway, h), min(ttc, t)
    return headway, ttc
