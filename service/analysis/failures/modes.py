"""Failure modes: dangerous rollouts grouped by how they came about.

Average linkage (scipy) on the motion before the moment, each number divided by a difference that an engineer would call
another thing. From the root of the tree downwards, a branch whose rollouts nearly all fall under one rule of
`service.analysis.failures.kinds` is a group and takes its name; another one is split. Groups of one name are one
mode, so that modes mean the same in every run, and a borderline rollout falls with those that it resembles. Rollouts
that no rule names are told apart by distance alone.
"""

from collections import Counter
from collections.abc import Sequence

import numpy as np
from scipy.cluster.hierarchy import ClusterNode, linkage, to_tree

from service.analysis.failures.kinds import kind_of
from service.analysis.failures.motion import Motion

AGREE = 0.95  # of a group's rollouts fall under the rule that it is named by
UNNAMED_WITHIN = 2.0  # groups without a name are split until their mean distance is below this
FAR = 3.0  # numbers count up to so many of their scales: nothing is told apart by being far beyond

SCALES = {  # a difference that makes another thing of it, in the number's own unit
    "ahead_m": 6.0,
    "left_m": 2.0,
    "closing_along_mps": 6.0,
    "closing_across_mps": 1.0,
    "heading_deg": 10.0,
    "before_ahead_m": 15.0,
    "before_left_m": 2.0,
    "ego_moved_left_m": 1.0,
    "other_moved_left_m": 1.0,
    "ego_lanes_left": 1.0,
    "other_lanes_left": 1.0,
    "ego_braking_mps2": 3.0,
    "other_braking_mps2": 3.0,
    "left_blocked": 1.0,
    "right_blocked": 1.0,
}


def modes_of(motions: Sequence[Motion]) -> list[str]:
    """The mode of each motion: a key of kinds.NAMES, those of "other" with a number each.

    The same for each motion in whatever order they come.
    """
    if not motions:
        return []
    kinds = [kind_of(motion) for motion in motions]
    points = features(motions)
    # linkage breaks ties by position; equal points are the same thing anyway
    order = np.lexsort(points.T[::-1])
    modes = [""] * len(motions)
    unnamed = 0
    for members in _groups(points[order], [kinds[i] for i in order]):
        name = _majority([kinds[order[i]] for i in members])[0]
        if name == "other":
            unnamed += 1
            name = f"other-{unnamed}"
        for i in members:
            modes[order[i]] = name
    return modes


def features(motions: Sequence[Motion]) -> np.ndarray:
    """(n, numbers) each in its scale, cut to +-FAR."""
    values = np.array([[float(getattr(m, name)) for name in SCALES] for m in motions])
    return np.clip(values / np.array(list(SCALES.values())), -FAR, FAR)


def _groups(points: np.ndarray, kinds: list[str]) -> list[list[int]]:
    if len(points) == 1:
        return [[0]]
    found: list[list[int]] = []
    branches: list[ClusterNode] = [to_tree(linkage(points, "average"))]
    while branches:
        branch = branches.pop()
        members = sorted(branch.pre_order())
        name, agree = _majority([kinds[i] for i in members])
        if branch.is_leaf() or (agree >= AGREE and (name != "other" or branch.dist <= UNNAMED_WITHIN)):
            found.append(members)
        else:
            branches += [branch.left, branch.right]
    return sorted(found)


def _majority(kinds: Sequence[str]) -> tuple[str, float]:
    """The most frequent kind, the first in the alphabet of equals, and its share."""
    name, times = min(Counter(kinds).items(), key=lambda item: (-item[1], item[0]))
    return name, times / len(kinds)
