"""Levels of a pilot, from what its paths have reached: the measure's own values, which may be of any sign."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ce.paths.tree import Fallen

Array = NDArray[np.float64]

# Paths, and different roots among them, that have to have come to a level for it to be aimed at.
ENOUGH_HITS, ENOUGH_ROOTS = 15, 6
# Numbers of hits at which a round's states are labelled.
LABELLED = (12, 25, 75, 225)
# Levels of the importance: as many times as probable as the aimed one.
RATIOS = (1.0, 4.0, 20.0, 100.0)
# How far below the aim the importance looks, in distances to the level above it.
BELOW = 1.5
# The most probable level that the importance looks at.
MOST_PROBABLE = 0.1


def reached(fallen: Fallen, hits: int = ENOUGH_HITS) -> float:
    """The lowest level that enough paths, from enough roots, have come to; +inf for none.

    fallen: where paths came to lower values
    hits: how many paths are enough
    """
    after, before = np.sort(fallen.after), np.sort(fallen.before)
    came = np.arange(1, after.size + 1) - np.searchsorted(before, after, side="right")
    for level in np.unique(after[(came >= hits) & ~np.isposinf(after)]):
        crossed = (fallen.after <= level) & (fallen.before > level)
        if np.unique(fallen.root[crossed]).size >= min(ENOUGH_ROOTS, hits):
            return float(level)
    return float("inf")


def to_label(fallen: Fallen, gamma: float, hits: Sequence[int] = LABELLED) -> Array:
    """Levels (k,), falling, at which a round's states are labelled, none below gamma.

    hits: how many paths have come to each
    """
    found = {max(reached(fallen, k), gamma) for k in hits}
    return np.array(sorted((b for b in found if np.isfinite(b)), reverse=True))


def ladder(fallen: Fallen, starts: int, aim: float, gamma: float) -> Array:
    """Levels (L,), falling, of the importance where `aim` is aimed at; below it, where gamma is not reached, one
    more.

    fallen: where weighted paths came to lower values
    starts: that they stand for
    aim: level, in the unit of the measure
    """
    order, other = np.argsort(fallen.after, kind="stable"), np.argsort(fallen.before, kind="stable")
    at, before = fallen.after[order], fallen.before[other]
    left = np.concatenate([[0.0], np.cumsum(fallen.weight[other])])[np.searchsorted(before, at, side="right")]
    p = np.maximum.accumulate((np.cumsum(fallen.weight[order]) - left) / starts)
    p_aim = float(p[np.searchsorted(at, aim, side="right") - 1]) if at.size and at[0] <= aim else 0.0
    levels = {aim}
    for ratio in RATIOS[1:]:
        wanted = min(p_aim * ratio, max(MOST_PROBABLE, p_aim))
        k = int(np.searchsorted(p, wanted))
        if p_aim > 0.0 and k < at.size and np.isfinite(at[k]) and at[k] > aim:
            levels.add(float(at[k]))
    ordered = sorted(levels)
    if aim > gamma and len(ordered) > 1:
        below = aim - BELOW * (ordered[1] - aim)
        ordered = [max(below, gamma), *ordered]
    return np.array(ordered[::-1])
