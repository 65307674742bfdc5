"""Post-encroachment time: how long after one vehicle left a place another was there."""

import math

import numpy as np

from policies.jit import kernel
from service.world import agents as A
from service.world.safety.boxes import separation

X, Y, COS, SIN, LENGTH, WIDTH, THERE = range(7)  # columns of the history
COLUMNS = 7
LONGEST_S = 10.0  # later than this is nobody's concern: infinite


@kernel
def remember(agents: np.ndarray, count: int, k: int, history: np.ndarray) -> None:
    """Write step k into the history (steps, rows, COLUMNS)."""
    for i in range(history.shape[1]):
        there = i < count and agents[i, A.ACTIVE] != 0.0
        history[k, i, THERE] = 1.0 if there else 0.0
        if there:
            history[k, i, X], history[k, i, Y] = agents[i, A.X_M], agents[i, A.Y_M]
            history[k, i, COS], history[k, i, SIN] = agents[i, A.COS], agents[i, A.SIN]
            history[k, i, LENGTH], history[k, i, WIDTH] = agents[i, A.LENGTH_M], agents[i, A.WIDTH_M]


@kernel
def _apart(a: np.ndarray, b: np.ndarray) -> float:
    return separation(
        a[X], a[Y], a[COS], a[SIN], a[LENGTH], a[WIDTH], b[X], b[Y], b[COS], b[SIN], b[LENGTH], b[WIDTH]
    )


@kernel
def _lag(history: np.ndarray, k: int, late: int, early: int, below: float) -> float:
    """Steps ago, less than `below`, that vehicle `early` was where vehicle `late` is at step k; inf for never.

    The box of `early` is followed back in time until it meets the box that `late` has now; between two steps the moment
    is interpolated from the boxes' separations.
    """
    if history[k, late, THERE] == 0.0:
        return math.inf
    before = math.inf  # separation one step later
    for lag in range(k + 1):
        if lag - 1.0 >= below:
            break
        if history[k - lag, early, THERE] == 0.0:
            before = math.inf
            continue
        gap = _apart(history[k, late], history[k - lag, early])
        if gap <= 0.0:
            if lag == 0 or before == math.inf:
                return float(lag)
            return lag - 1.0 + before / (before - gap)
        before = gap
    return math.inf


@kernel
def encroachment(history: np.ndarray, k: int, ego: int, below: float) -> float:
    """Steps (at most `below`) between one leaving and the other being at a place, for the ego and each other vehicle,
    where the later of the two is there at step k; inf for none."""
    least = math.inf
    for j in range(history.shape[1]):
        if j != ego:
            least = min(least, _lag(history, k, ego, j, min(least, below)))
            least = min(least, _lag(history, k, j, ego, min(least, below)))
    return least
