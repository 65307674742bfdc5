"""Confidence intervals for an event's probability.

Counts: Clopper and Pearson, Biometrika 26 (1934). Weighted events: the gamma interval of Fay and Feuer,
Statistics in Medicine 16 (1997), made for weighted sums of rare counts. With y the estimate, v its variance
and w the largest single contribution,

    lower = G^{-1}(a/2; mean y, variance v),    upper = G^{-1}(1 - a/2; mean y + w, variance v + w^2),

G the gamma distribution. It is skewed like the estimate itself, equals Garwood's exact Poisson interval for
equal weights, and stays wide while one weight dominates, where p +- 1.96 se would be far too narrow.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import betaincinv, gammaincinv

Array = NDArray[np.float64]


def clopper_pearson(events: ArrayLike, n: int, confidence: float) -> tuple[Array, Array]:
    """Lower and upper ends for a binomial proportion; (0, 1) for n = 0.

    events: (...), how many of the n trials were events
    n: trials
    confidence: of the interval, in (0, 1)

    >>> low, high = clopper_pearson(0, 100, 0.95)
    >>> f"{low:.3f} {high:.3f}"
    '0.000 0.036'
    """
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
    """Lower and upper ends of Fay and Feuer's interval, cut to [0, 1]; arrays of one shape.

    p: estimate
    variance: of the estimate
    largest: the largest contribution of one rollout to p, its weight / n; where p = 0, what an event would contribute
    confidence: of the interval, in (0, 1)
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


@dataclass(frozen=True)
class EventSums:
    """What p and its interval are made from: sums over the events of n rollouts, at m thresholds.

    n: rollouts
    counts: (m,), events
    sums: (m,), of the events' weights
    squares: (m,), sums of their squares
    largest: (m,), the largest of the events' weights
    failed: (k,), weights of the failed rollouts
    largest_of_any: the largest weight of any rollout, at least 1, as E[w] = 1
    """

    n: int
    counts: Array
    sums: Array
    squares: Array
    largest: Array
    failed: Array
    largest_of_any: float

    @property
    def p(self) -> Array:
        """Estimate of the probability (m,); weights of a certain event may sum to a little more than n."""
        return np.minimum(self.sums / self.n, 1.0)


def counted_interval(of: EventSums, confidence: float) -> tuple[Array, Array, Array]:
    """Standard error, lower and upper end (m,) for equal weights; the upper end counts failures as events."""
    p = of.p
    low, _ = clopper_pearson(of.counts, of.n, confidence)
    _, high = clopper_pearson(of.counts + of.failed.size, of.n, confidence)
    std_error: Array = np.sqrt(p * (1.0 - p) / of.n)
    return std_error, low, high


def weighted_interval(of: EventSums, confidence: float) -> tuple[Array, Array, Array]:
    """Standard error, lower and upper end (m,) for any weights; the upper end counts failures as events."""
    n = of.n
    std_error: Array = np.sqrt(_variance(n, of.sums, of.squares))
    low, _ = weighted_gamma(of.p, std_error**2, of.largest / n, confidence)
    # Weights without any spread: nothing but the number of events is uncertain.
    counted_low, _ = clopper_pearson(of.counts, n, confidence)
    low = np.where((std_error == 0.0) & (of.counts > 0), np.minimum(low, counted_low * of.p), low)
    upper_sums, upper_squares = of.sums + of.failed.sum(), of.squares + np.sum(of.failed**2)
    upper_largest = np.maximum(of.largest, np.max(of.failed, initial=0.0))
    # No event at all: what one would weigh is unknown; the largest weight met stands in for it.
    upper_largest = np.where(upper_largest > 0, upper_largest, of.largest_of_any)
    _, high = weighted_gamma(
        upper_sums / n, _variance(n, upper_sums, upper_squares), upper_largest / n, confidence
    )
    return std_error, low, high


def _variance(n: int, sums: Array, squares: Array) -> Array:
    """Of the mean of n terms with those sums (m,) and sums of squares (m,)."""
    variance: Array = np.maximum(squares / n - (sums / n) ** 2, 0.0) / max(n - 1, 1)
    return variance
