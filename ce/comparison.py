"""Two systems on the same question: difference and ratio of their probabilities, with intervals.

On common random numbers (the same draws and weights, so the i-th rollouts of both share x and noise) the variance of
the difference is that of the paired terms, w_i (1{f_a <= gamma} - 1{f_b <= gamma}); otherwise variances add.
"""

import math
from dataclasses import dataclass

import numpy as np
from scipy.special import ndtri

from ce.errors import OptionsError
from ce.replicated import ReplicatedEstimate
from ce.results import Estimate


@dataclass(frozen=True)
class Comparison:
    """How p of one system compares with p of another.

    difference: p_a - p_b
    difference_std_error: its standard error
    difference_ci: lower and upper end of its interval
    ratio: p_a / p_b, NaN where p_b = 0
    ratio_ci: lower and upper end of its interval
    paired: whether from common random numbers
    confidence: of the intervals, in (0, 1)
    """

    difference: float
    difference_std_error: float
    difference_ci: tuple[float, float]
    ratio: float
    ratio_ci: tuple[float, float]
    paired: bool
    confidence: float


def compare(a: Estimate, b: Estimate) -> Comparison:
    """How p of `a` compares with p of `b`; OptionsError where their confidences differ.

    Intervals are normal: of the difference as it is, of the ratio on its logarithm (from 0 to infinity where either p
    is 0). They are as good as both estimates' own intervals: see their warnings.

    >>> import ce
    >>> base = ce.Product([ce.Normal([0.0], [[1.0]])])
    >>> a = ce.estimate(lambda x: 2.0 - x[:, 0], base, 0.0, "naive", budget=10_000, seed=1)
    >>> b = ce.estimate(lambda x: 2.2 - x[:, 0], base, 0.0, "naive", budget=10_000, seed=1)
    >>> found = ce.compare(a, b)
    >>> found.paired, found.difference > 0.0, found.ratio_ci[0] > 1.0
    (True, True, True)
    """
    if a.confidence != b.confidence:
        raise OptionsError(f"the estimates have different confidences, {a.confidence} and {b.confidence}")
    covariance, paired = 0.0, _common(a, b)
    if paired:
        w = np.ones(a.f.size) if a.log_weights is None else np.exp(a.log_weights)
        terms = np.cov(w * (a.f <= a.gamma), w * (b.f <= b.gamma))
        covariance = float(terms[0, 1]) / a.f.size
    variance = max(a.std_error**2 + b.std_error**2 - 2.0 * covariance, 0.0)
    z = float(ndtri(0.5 + 0.5 * a.confidence))
    difference, error = a.p - b.p, math.sqrt(variance)
    ratio, ratio_ci = math.nan, (0.0, math.inf)
    if b.p > 0:
        ratio = a.p / b.p
        if a.p > 0:
            relative = (a.std_error / a.p) ** 2 + (b.std_error / b.p) ** 2 - 2.0 * covariance / (a.p * b.p)
            factor = math.exp(z * math.sqrt(max(relative, 0.0)))
            ratio_ci = (ratio / factor, ratio * factor)
    return Comparison(
        difference,
        error,
        (difference - z * error, difference + z * error),
        ratio,
        ratio_ci,
        paired,
        a.confidence,
    )


def _common(a: Estimate, b: Estimate) -> bool:
    """Whether the i-th rollouts of both had the same draw.

    They have where their weights are equal (`ce.paired`), or where both are naive Monte Carlo of equal size and seed,
    which the caller answers for by giving both jobs the same seed.
    """
    if isinstance(a, ReplicatedEstimate) or isinstance(b, ReplicatedEstimate) or not 1 < a.f.size == b.f.size:
        return False
    if a.log_weights is None or b.log_weights is None:
        return a.log_weights is None and b.log_weights is None and a.seed is not None and a.seed == b.seed
    return bool(np.array_equal(a.log_weights, b.log_weights))
