"""Levels of a pilot, from what its paths have reached: the measure's own values, which may be of any sign."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

# Paths, and different roots among them, that have to have come to a level for it to be aimed at.
ENOUGH_HITS, ENOUGH_ROOTS = 25, 8
# Numbers of hits at which a round's states are labelled.
LABELLED = (12, 25, 75, 225)
# Levels of the importance: as many times as probable as the aimed one.
RATIOS = (1.0, 3.0, 10.0, 40.0)
# The most probable level that the importance looks at.
MOST_PROBABLE = 0.05


def reached(value: Array, root: NDArray[np.int64], hits: int = ENOUGH_HITS) -> float:
    """The lowest level that enough paths, from enough roots, have come to; +inf for none.

    value: (n,), smallest measures, NaN = failed
    root: (n,), of each path
    hits: how many paths are enough
    """
    order = np.argsort(value, kind="stable")
    order = order[np.isfinite(value[order]) | (value[order] == -np.inf)]
    if order.size < hits:
        return float("inf")
    _, first = np.unique(root[order], return_index=True)
    if first.size < min(ENOUGH_ROOTS, hits):
        return float("inf")
    at = max(hits - 1, int(np.sort(first)[min(ENOUGH_ROOTS, hits) - 1]))
    return float(value[order[at]])


def to_label(value: Array, root: NDArray[np.int64], gamma: float) -> Array:
    """Levels (k,), falling, at which a round's states are labelled, none below gamma."""
    found = {max(reached(value, root, k), gamma) for k in LABELLED}
    return np.array(sorted((b for b in found if np.isfinite(b)), reverse=True))


def ladder(value: Array, weight: Array, starts: int, aim: float, gamma: float) -> Array:
    """Levels (L,), falling, of the importance where `aim` is aimed at; below it, where gamma is not reached, one
    more.

    value: (n,), smallest measures of weighted paths
    weight: (n,), their weights
    starts: that they stand for
    aim: level, in the unit of the measure
    """
    order = np.argsort(value, kind="stable")
    order = order[~np.isnan(value[order])]
    at, p = value[order], np.cumsum(weight[order]) / starts
    p_aim = float(p[np.searchsorted(at, aim, side="right") - 1]) if at.size and at[0] <= aim else 0.0
    levels = {aim}
    for ratio in RATIOS[1:]:
        wanted = min(p_aim * ratio, max(MOST_PROBABLE, p_aim))
        k = int(np.searchsorted(p, wanted))
        if p_aim > 0.0 and k < at.size and np.isfinite(at[k]) and at[k] > aim:
            levels.add(float(at[k]))
    ordered = sorted(levels)
    if aim > gamma and len(ordered) > 1:
        below = aim - (ordered[1] - aim)
        ordered = [max(below, gamma), *ordered]
    return np.array(ordered[::-1])
