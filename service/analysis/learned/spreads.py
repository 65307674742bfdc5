"""The spread of one coordinate: of a distribution exactly, of weighted draws as far as they go."""

import math

import numpy as np
from scipy.special import betaincinv, ndtri

import ce
from service.analysis.learned.objects import Spread

LEVELS = (0.05, 0.25, 0.5, 0.75, 0.95)
NODES = 96  # of the quadrature: exact to rounding for the smooth maps of ce's marginals


def spread_of(block: ce.Beta | ce.Marginal) -> Spread:
    """Of a one-dimensional distribution."""
    if isinstance(block, ce.Beta):
        total, width = block.alpha + block.beta, block.high - block.low
        mean = block.low + width * block.alpha / total
        sd = width * math.sqrt(block.alpha * block.beta / (total + 1.0)) / total
        at = block.low + width * betaincinv(block.alpha, block.beta, LEVELS)
    else:
        nodes, weights = np.polynomial.hermite_e.hermegauss(NODES)  # x = T(u), u ~ N(shift, 1)
        values, weights = block.from_standard(nodes + block.shift), weights / weights.sum()
        mean = float(weights @ values)
        sd = math.sqrt(float(weights @ (values - mean) ** 2))
        at = block.from_standard(ndtri(np.array(LEVELS)) + block.shift)
    return _spread(mean, sd, at)


def sample_spread(values: np.ndarray, weights: np.ndarray) -> Spread:
    """Of draws (n,) with weights (n,) that need not sum to one."""
    w = weights / weights.sum()
    mean = float(w @ values)
    sd = math.sqrt(max(float(w @ (values - mean) ** 2), 0.0))
    order = np.argsort(values, kind="stable")
    # mid-points, so that the median of equal weights is the median
    total = np.cumsum(w[order]) - 0.5 * w[order]
    return _spread(mean, sd, np.interp(LEVELS, total, values[order]))


def _spread(mean: float, sd: float, at: np.ndarray) -> Spread:
    q05, q25, q50, q75, q95 = (float(v) for v in at)
    return Spread(mean=mean, sd=sd, q05=q05, q25=q25, q50=q50, q75=q75, q95=q95)
