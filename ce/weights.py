"""Likelihood-ratio weights, kept as logarithms until the last line."""

import math

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def normalised(log_weights: Array) -> Array:
    """exp(log w) divided by its sum, (n,): the maximum is subtracted first. Empty in, empty out."""
    if log_weights.size == 0:
        return np.zeros(0)
    w: Array = np.exp(log_weights - np.max(log_weights))
    w /= np.sum(w)
    return w


def effective_sample_size(log_weights: Array) -> float:
    """(sum w)^2 / sum w^2 (Kong 1992), in 1..n; 0 for no weights."""
    if log_weights.size == 0:
        return 0.0
    w = normalised(log_weights)
    return 1.0 / float(np.sum(w * w))


def max_share(log_weights: Array) -> float:
    """Largest weight over their sum, 0 for no weights."""
    return float(np.max(normalised(log_weights), initial=0.0))


def order_statistic(f: Array, level: float) -> float:
    """The level-quantile of f as one of its values: the ceil(level n)-th smallest, NaN for an empty f.

    A value of the sample, not an interpolation, because f may hold infinities.
    """
    if f.size == 0:
        return math.nan
    rank = min(max(math.ceil(level * f.size - 1e-9), 1), f.size)
    return float(np.partition(f, rank - 1)[rank - 1])
