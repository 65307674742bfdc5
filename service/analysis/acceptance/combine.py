"""Sums and ratios of numbers that are not known exactly: bounds by melding their confidence distributions.

A bound of a function that rises in some numbers and falls in others is a quantile of the function of independent draws,
from the upper distributions of those that it rises in and the lower ones of the others, or the other way round (Fay,
Proschan and Brittain 2015). Draws are a Latin hypercube with a seed of its own: the same bits each time, and exact
where one number alone is uncertain.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import ndtr, ndtri

from service.analysis.acceptance.quantity import Array, Quantiles, Quantity

DRAWS = 16_384
SEED = 0x6D656C64


@dataclass(frozen=True)
class Combined:
    """A combination of uncertain numbers.

    value: of their estimates
    low, high: DRAWS draws each of what the lower and the upper bound are quantiles of, ascending
    """

    value: float
    low: Array
    high: Array

    def lower(self, confidence: float) -> float:
        """One-sided lower bound at the level `confidence`."""
        return _quantile(self.low, 1.0 - confidence)

    def upper(self, confidence: float) -> float:
        """One-sided upper bound."""
        return _quantile(self.high, confidence)

    def interval(self, confidence: float) -> tuple[float, float]:
        """Two-sided."""
        one_sided = 0.5 + 0.5 * confidence
        return self.lower(one_sided), self.upper(one_sided)


def _quantile(ascending: Array, level: float) -> float:
    """The draws stand for the levels (i + 1/2) / DRAWS."""
    at = (np.arange(ascending.size) + 0.5) / ascending.size
    return float(np.interp(level, at, ascending))


EVEN = (np.arange(DRAWS) + 0.5) / DRAWS
GRID = ndtr(np.linspace(float(ndtri(EVEN[0])), float(ndtri(EVEN[-1])), 513))  # where quantiles are worked out


def _draws(quantiles: Quantiles, rng: np.random.Generator | None) -> Array:
    """DRAWS draws, evenly spread over the levels, in random order; in rising order without `rng`."""
    found: Array = np.interp(EVEN, GRID, quantiles(GRID))
    return found if rng is None else rng.permutation(found)


def sum_of_products(terms: Sequence[tuple[Quantity, Quantity]]) -> Combined:
    """Of sum a_i b_i, all non-negative: rates of scenarios times probabilities."""
    low, high = np.zeros(DRAWS), np.zeros(DRAWS)
    low_rng, high_rng = (np.random.Generator(np.random.Philox(key=SEED)) for _ in range(2))
    for i, (a, b) in enumerate(terms):
        # the first stays in order: where it is the only uncertain one, its draws are evenly spread
        low += _draws(b.lower, low_rng if i else None) * _draws(a.lower, low_rng)
        high += _draws(b.upper, high_rng if i else None) * _draws(a.upper, high_rng)
    return Combined(sum(a.value * b.value for a, b in terms), np.sort(low), np.sort(high))


def ratio(over: Combined, under: Quantity) -> Combined:
    """Of a rate over another; infinite where the other may be 0."""
    rng = np.random.Generator(np.random.Philox(key=SEED + 1))
    most, least = _draws(under.upper, rng), _draws(under.lower, rng)
    with np.errstate(divide="ignore", invalid="ignore"):
        low = np.nan_to_num(over.low / most, nan=0.0, posinf=np.inf)
        high = np.nan_to_num(over.high / least, nan=np.inf, posinf=np.inf)
        value = over.value / under.value if under.value > 0.0 else np.inf
    return Combined(float(value), np.sort(low), np.sort(high))
