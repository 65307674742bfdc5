"""Numbers that are not known exactly: each as two confidence distributions, for its lower and its upper bound.

The lower bound at a level is a quantile of the lower distribution, the upper bound one of the upper distribution; for
counts they differ, as Clopper and Pearson's bounds do (Fay, Proschan and Brittain 2015, Biometrics 71: melded
confidence intervals).
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import betaincinv, gammaincinv, ndtri

Array = NDArray[np.float64]
Quantiles = Callable[[Array], Array]
# levels of the intervals that a table is made of: close to 1, for what lies far out
TABLE = np.array([0.02, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.85, 0.9, 0.93, 0.95, 0.97, 0.98, 0.99, 0.995,
                  0.998, 0.999, 0.9998])  # fmt: skip


@dataclass(frozen=True)
class Quantity:
    """A number that is not known exactly.

    value: the estimate
    lower, upper: quantiles of its two confidence distributions at levels (n,) in (0, 1)
    samples: how many rollouts or the like it rests on, 0 where that means nothing
    """

    value: float
    lower: Quantiles
    upper: Quantiles
    samples: int = 0

    def interval(self, confidence: float) -> tuple[float, float]:
        """Two-sided, at the level `confidence`."""
        tail = 0.5 * (1.0 - confidence)
        return float(self.lower(np.array([tail]))[0]), float(self.upper(np.array([1.0 - tail]))[0])


def exactly(value: float) -> Quantity:
    """A number that is known."""

    def same(u: Array) -> Array:
        return np.full(u.shape, value)

    return Quantity(value, same, same)


def counted(events: int, rollouts: int, failed: int = 0) -> Quantity:
    """A probability from a count (Clopper and Pearson); failed: rollouts that may have been events."""
    k, most = events, min(events + failed, rollouts)

    def lower(u: Array) -> Array:
        found: Array = betaincinv(k, rollouts - k + 1.0, u) if k else np.zeros(u.shape)
        return found

    def upper(u: Array) -> Array:
        found: Array = betaincinv(most + 1.0, rollouts - most, u) if most < rollouts else np.ones(u.shape)
        return found

    return Quantity(k / rollouts, lower, upper, rollouts)


def happened(events: int, exposure: float) -> Quantity:
    """A rate from a Poisson count over a known exposure (Garwood)."""

    def lower(u: Array) -> Array:
        found: Array = gammaincinv(events, u) / exposure if events else np.zeros(u.shape)
        return found

    def upper(u: Array) -> Array:
        found: Array = gammaincinv(events + 1.0, u) / exposure
        return found

    return Quantity(events / exposure, lower, upper)


def told(value: float, low: float, high: float, confidence: float) -> Quantity:
    """A number of which an estimate and an interval are all that is known: normal on the logarithm to either side of
    the estimate; where the lower end is 0, exponential above it."""
    z = float(ndtri(0.5 + 0.5 * confidence))
    tail = 0.5 * (1.0 - confidence)

    def below(u: Array) -> Array:
        if low <= 0.0 or value <= 0.0:
            return np.where(u <= 0.5, 0.0, value)
        found: Array = value * np.exp(np.minimum(ndtri(u), 0.0) * math.log(value / low) / z)
        return found

    def above(u: Array) -> Array:
        if value <= 0.0:
            found: Array = high * np.log1p(-u) / math.log(tail)
            return found
        risen: Array = value * np.exp(np.maximum(ndtri(u), 0.0) * math.log(high / value) / z)
        return risen

    def both(u: Array) -> Array:
        return np.where(u < 0.5, below(u), above(u))

    return Quantity(value, both, both)


def tabled(value: float, interval_at: Callable[[float], tuple[float, float]], samples: int = 0) -> Quantity:
    """A number whose interval can be had at any level.

    interval_at: two-sided interval at a level of confidence

    Each distribution's own half is read off the interval's ends; the other half is the other distribution's, moved so
    that it meets.
    """
    ends = np.array([interval_at(float(c)) for c in TABLE])
    z = ndtri(0.5 + 0.5 * TABLE)
    lows, highs = np.maximum.accumulate(ends[::-1, 0])[::-1], np.maximum.accumulate(ends[:, 1])
    apart = max(float(highs[0] - lows[0]), 0.0)

    def low_half(u: Array) -> Array:
        found: Array = np.interp(-ndtri(u), z, lows)
        return found

    def high_half(u: Array) -> Array:
        found: Array = np.interp(ndtri(u), z, highs)
        return found

    def lower(u: Array) -> Array:
        return np.where(u < 0.5, low_half(u), np.maximum(high_half(u) - apart, lows[0]))

    def upper(u: Array) -> Array:
        return np.where(u < 0.5, np.minimum(low_half(u) + apart, highs[0]), high_half(u))

    return Quantity(value, lower, upper, samples)


def sharper(of: Quantity, times: float) -> Quantity:
    """The quantity as `times` as many rollouts would tell it, if they say the same."""
    if of.value <= 0.0:
        return Quantity(
            0.0, lambda u: of.lower(u) / times, lambda u: of.upper(u) / times, round(of.samples * times)
        )
    root = math.sqrt(times)

    def nearer(ends: Quantiles) -> Quantiles:
        def at(u: Array) -> Array:
            found: Array = of.value * np.exp(np.log(np.maximum(ends(u), 1e-300) / of.value) / root)
            return found

        return at

    return Quantity(of.value, nearer(of.lower), nearer(of.upper), round(of.samples * times))
