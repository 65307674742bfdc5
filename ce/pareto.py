"""Pareto k of importance weights: how heavy their tail is, hence whether a standard error means anything.

A generalised Pareto distribution is fitted to the largest weights (Vehtari, Simpson, Gelman, Yao and Gabry,
JMLR 25, 2024) by the empirical-Bayes rule of Zhang and Stephens (Technometrics 51, 2009). Its shape k
bounds the moments: the variance of the weights is finite only for k < 0.5, and above 0.7 no practicable
number of samples gives a usable mean.
"""

import math

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

# Weights in the tail below which nothing is fitted.
LEAST_TAIL = 5


def pareto_k(weights: Array) -> float:
    """Shape k of the upper tail of weights (n,) >= 0, any scale; -inf for a tail of equal weights, NaN for n < 25."""
    n = weights.size
    tail = min(int(0.2 * n), math.ceil(3.0 * math.sqrt(n)))
    if tail < LEAST_TAIL:
        return math.nan
    largest = np.sort(np.partition(weights, n - tail - 1)[n - tail - 1 :])
    scale = largest[-1]
    if not scale > 0:
        return -math.inf
    excess = (largest[1:] - largest[0]) / scale
    excess = excess[excess > 1e-12]
    if excess.size < LEAST_TAIL:
        return -math.inf
    return _fit(excess)


def _fit(x: Array) -> float:
    """k of a generalised Pareto distribution for excesses x (m,) > 0, ascending."""
    m = x.size
    grid = 30 + int(math.sqrt(m))
    b = 1.0 - np.sqrt(grid / (np.arange(1, grid + 1) - 0.5))
    b = b / (3.0 * x[int(m / 4 + 0.5) - 1]) + 1.0 / x[-1]
    k = np.log1p(-b[:, None] * x).mean(axis=1)
    log_likelihood = m * (np.log(-b / k) - k - 1.0)
    posterior = np.exp(log_likelihood - log_likelihood.max())
    b_mean = float(np.sum(b * posterior) / np.sum(posterior))
    k_mean = float(np.log1p(-b_mean * x).mean())
    return (m * k_mean + 10.0 * 0.5) / (m + 10.0)  # shrunk towards 0.5, worth ten observations
