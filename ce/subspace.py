"""Where weighted samples differ from N(0, I): the screen that makes the cross-entropy method work in high dimension.

A weighted mean of n_eff samples is off by 1/sqrt(n_eff) in every coordinate, and its noise adds up over the
coordinates: moving all of d means wastes d / (2 n_eff) nats. So only what stands out of that noise is moved:
- coordinates whose mean or variance is beyond what the largest of d noisy ones would be, if they are few of all;
- of the rest, the directions in which f falls by regression (`ce.regression`), where any are given;
- of what is left, the direction of its mean, where the length is beyond noise (Rubinstein's update, confined to
  where El Masri, Morio and Simatos, Reliability Engineering & System Safety 216, 2021, show it to be optimal);
- of the rest, principal directions whose variance leaves the Marchenko-Pastur interval.

Projections on directions found from the same samples are too good by construction. Each sample's own
contribution to the direction is therefore taken out of its projection (leave one out, to first order), which
for the mean is the James-Stein shrinkage.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ce.regression import Direction

Array = NDArray[np.float64]

# Dimensions up to which every coordinate is kept.
LARGEST_FREE = 12
# Significant coordinates above which directions are used instead.
MOST_COORDINATES = 40
MOST_DIRECTIONS = 5
# Dimensions up to which principal directions are looked for.
LARGEST_PCA = 1000
# Effective number of samples that make up a direction's variance, at least.
LEAST_SUPPORT = 30
# Share of a given direction's squared length outside the kept coordinates from which it is of use.
LEAST_NEW_SHARE = 0.1
# Beyond the Marchenko-Pastur edge.
_MARGIN = 1.15


@dataclass(frozen=True)
class Subspace:
    """A subspace in which weighted samples differ from N(0, I).

    basis: (d, r), orthonormal
    y: (n, r), projections with each sample's own influence removed
    scale: common standard deviation of what is orthogonal to it
    """

    basis: Array
    y: Array
    scale: float


def find(u: Array, w: Array, directions: Sequence[Direction] = (), ess_limit: float = math.inf) -> Subspace:
    """The subspace for samples u (n, d) with weights w (n,) that sum to one.

    directions: to be kept, best first, each with every sample's influence on it
    ess_limit: effective number of samples at most, where they depend on each other
    """
    d = u.shape[1]
    ess = min(1.0 / float(np.sum(w * w)), ess_limit)
    if d <= LARGEST_FREE:
        return Subspace(np.eye(d), u, 1.0)
    mean, second = w @ u, w @ (u * u)
    # The weights' own spread of each statistic, but not less than that of N(0, 1) from n_eff equal weights.
    w2 = w * w
    spread = np.sqrt(np.maximum(w2 @ (u * u), 1.0 / ess))
    spread2 = np.sqrt(np.maximum(w2 @ (u * u - 1.0) ** 2, 2.0 / ess))
    z = np.maximum(np.abs(mean) / spread, np.abs(second - 1.0) / spread2)
    kept = np.flatnonzero(z > math.sqrt(2.0 * math.log(2.0 * d)) + 0.3)
    if kept.size > min(MOST_COORDINATES, d // 4):
        kept = kept[:0]
    columns = list(np.eye(d)[kept])
    projections = [u[:, i] for i in kept]
    left = u.copy()
    left[:, kept] = 0.0
    for given in directions:
        direction = given.vector.copy()
        for column in columns:
            direction -= (direction @ column) * column
        size = math.sqrt(float(direction @ direction))
        if size * size < LEAST_NEW_SHARE:
            continue
        direction /= size
        along = left @ direction
        projections.append(along - given.influence / size)
        columns.append(direction)
        left = left - np.outer(along, direction)
    norm = d - len(columns)
    own = w * np.sum(left * left, axis=1)
    centre = w @ left
    length2 = float(centre @ centre)
    if norm and (ess * length2 - norm) / math.sqrt(2.0 * norm) > 3.0:
        length = math.sqrt(length2)
        direction = centre / length
        projections.append((left @ centre - own) / length)
        columns.append(direction)
        left = left - np.outer(left @ direction, direction)
        norm -= 1
    if norm > 1 and d <= LARGEST_PCA:
        for direction, projection in _principal(left, w, ess, norm):
            columns.append(direction)
            projections.append(projection)
            left = left - np.outer(left @ direction, direction)
            norm -= 1
    scale = 1.0
    if norm > 0:
        variance = float(w @ np.sum(left * left, axis=1)) / norm
        if abs(variance - 1.0) > 3.0 * math.sqrt(2.0 / (norm * ess)):
            scale = math.sqrt(variance)
    basis = np.stack(columns, axis=1) if columns else np.zeros((d, 0))
    y = np.stack(projections, axis=1) if projections else np.zeros((u.shape[0], 0))
    return Subspace(basis, y, scale)


def _principal(left: Array, w: Array, ess: float, norm: int) -> list[tuple[Array, Array]]:
    """Directions of `left` whose second moment leaves the noise interval, with their corrected projections."""
    aspect = norm / ess
    if aspect > 4.0:
        return []
    values, vectors = np.linalg.eigh((w[:, None] * left).T @ left)
    bulk = float(np.median(values[-norm:])) if aspect < 1.0 else float(values.sum()) / norm
    high = _MARGIN * bulk * (1.0 + math.sqrt(aspect)) ** 2
    low = bulk * (1.0 - math.sqrt(aspect)) ** 2 / _MARGIN if aspect < 0.5 else -math.inf
    first = values.size - norm  # below: directions that were projected out
    found = [i for i in range(first, values.size) if values[i] > high or values[i] < low]
    strength = [values[i] / bulk - 1.0 - math.log(max(values[i] / bulk, 1e-12)) for i in found]
    chosen = [found[j] for j in np.argsort(strength)[::-1][:MOST_DIRECTIONS]]
    squares = (left @ vectors) ** 2
    out = []
    for i in chosen:
        shares = w * squares[:, i] / values[i]
        if float(np.sum(shares * shares)) * LEAST_SUPPORT > 1.0:
            continue  # a few heavy samples, not a direction of the event
        gap = values[i] - values
        gap[i] = math.inf
        gap[:first] = math.inf
        own = w * np.sum(squares / gap, axis=1)
        out.append((vectors[:, i], (left @ vectors[:, i]) * np.clip(1.0 - own, 0.0, 2.0)))
    return out
