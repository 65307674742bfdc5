"""Confidence intervals for an event's probability.

Counts: Clopper and Pearson, Biometrika 26 (1934). Weighted events: the gamma interval of Fay and Feuer,
Statistics in Medicine 16 (1997), made for weighted sums of rare counts. With y the estimate, v its variance
and w the largest single contribution,

    lower = G^{-1}(a/2; mean y, variance v),    upper = G^{-1}(1 - a/2; mean y + w, variance v + w^2),

G the gamma distribution. It is skewed like the estimate itself, equals Garwood's exact Poisson interval for
equal weights, and stays wide while one weight dominates, where p +- 1.96 se would be far too narrow.
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import betaincinv, gammaincinv

Array = NDArray[np.float64]


def clopper_pearson(events: ArrayLike, n: int, confidence: float) -> tuple[Array, Array]:
    """Lower and upper ends for a binomial proportion; events may be an array. (0, 1) for n = 0."""
    k = np.asarray(events, dtype=np.float64)
    if n == 0:
        return np.zeros_like(k), np.ones_like(k)
    tail = 0.5 * (1.0 - confidence)
    lower = np.where(k > 0, betaincinv(np.maximum(k, 1), n - np.maximum(k, 1) + 1, tail), 0.0)
    upper = np.where(k < n, betaincinv(np.minimum(k, n - 1) + 1, n - np.minimum(k, n - 1), 1.0 - tail), 1.0)
    return lower, upper


def weighted_gamma(
    p: ArrayLike, variance: ArrayLike, largest: ArrayLike, confidence: float
) -> tuple[Array, Array]:
    """Fay and Feuer's interval, cut to [0, 1].

    p: estimate; variance: of the estimate; largest: the largest contribution of one rollout to p (its
    weight / n; where p = 0, what an event would contribute). Arrays of one shape.
    """
    p, variance, largest = np.broadcast_arrays(
        *(np.asarray(a, dtype=np.float64) for a in (p, variance, largest))
    )
    tail = 0.5 * (1.0 - confidence)
    some = (p > 0) & (variance > 0)
    shape = np.where(some, p**2 / np.where(some, variance, 1.0), 1.0)
    lower = np.where(
        some, gammaincinv(shape, tail) * np.where(some, variance, 0.0) / np.where(some, p, 1.0), p
    )
    mean, spread = p + largest, variance + largest**2
    upper_shape = mean**2 / np.where(spread > 0, spread, 1.0)
    upper = np.where(spread > 0, gammaincinv(upper_shape, 1 - tail) * spread / np.maximum(mean, 1e-300), p)
    return np.clip(lower, 0.0, 1.0), np.clip(upper, 0.0, 1.0)
