"""Who drives ahead of whom in a scene."""

import numpy as np

from policies.data.scenes import Scene


def leaders(scene: Scene) -> np.ndarray:
    """Column (F, N) of the next vehicle ahead in the same lane, -1 where there is none."""
    found = np.full(scene.lane.shape, -1, dtype=np.int64)
    for f in range(len(scene.frame)):
        here = np.flatnonzero(scene.lane[f] >= 0)
        order = here[np.lexsort((scene.station[f, here], scene.lane[f, here]))]
        same = scene.lane[f, order[:-1]] == scene.lane[f, order[1:]]
        found[f, order[:-1][same]] = order[1:][same]
    return found


def leader_of(scene: Scene, v: int) -> np.ndarray:
    """The same (F,) for one column."""
    ahead = (scene.lane == scene.lane[:, v : v + 1]) & (scene.station > scene.station[:, v : v + 1])
    distance = np.where(ahead, scene.station - scene.station[:, v : v + 1], np.inf)
    nearest = distance.argmin(axis=1)
    known = ahead.any(axis=1) & (scene.lane[:, v] >= 0)
    return np.where(known, nearest, -1)


def bumper_gaps(scene: Scene, ahead: np.ndarray) -> np.ndarray:
    """Distance (F, N) in m from each front bumper to the rear bumper of `ahead` (see leaders); NaN without one."""
    safe = np.maximum(ahead, 0)
    rows = np.arange(len(scene.frame))[:, None]
    centres = scene.station[rows, safe] - scene.station
    gap = centres - 0.5 * (scene.length_m[safe] + scene.length_m)
    return np.where(ahead >= 0, gap, np.nan)
