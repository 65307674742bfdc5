"""The paper's two ratios against naive Monte Carlo, with intervals, and efficiency with training counted."""

import math
from typing import NamedTuple

import numpy as np
from scipy.special import gammaincinv, ndtri

from ce.interval import clopper_pearson

Z = float(ndtri(0.975))


class Ratio(NamedTuple):
    """A ratio with its 95% interval; NaN where it is not known."""

    value: float
    low: float
    high: float


UNKNOWN = Ratio(math.nan, math.nan, math.nan)


def ratio_of_rare_events(events: int, rollouts: int, naive_events: int, naive_rollouts: int) -> Ratio:
    """Events a rollout under the proposal over events a rollout under P0 (Figures 2a and 3a).

    The interval is exact for Poisson counts: given their sum, the first count is binomial (Clopper and Pearson).
    """
    if not rollouts or not naive_rollouts or not events + naive_events:
        return UNKNOWN
    low, high = clopper_pearson(np.array([events]), events + naive_events, 0.95)
    scale = naive_rollouts / rollouts

    def odds(share: float) -> float:
        return scale * share / (1.0 - share) if share < 1.0 else math.inf

    value = scale * events / naive_events if naive_events else math.nan
    return Ratio(value, odds(float(low[0])), odds(float(high[0])))


def ratio_of_variances(
    p: float, p_error: float, std_error: float | None, variance_error: float | None, rollouts: int
) -> Ratio:
    """Variance of naive Monte Carlo with `rollouts` over an estimator's (Figures 2b and 3b).

    p: the best known
    p_error: its relative standard error
    variance_error: that of std_error squared
    rollouts: those of the estimation for the paper's ratio, all of them for the efficiency

    The interval is of the logarithm, by the delta method; where a few events carry the variance it is too narrow,
    which the run's warnings say.
    """
    if not std_error or variance_error is None or not p > 0.0:
        return UNKNOWN
    value = p * (1.0 - p) / rollouts / std_error**2
    spread = math.exp(Z * math.hypot(p_error, variance_error))
    return Ratio(value, value / spread, value * spread)


def efficiency_of_repeats(p: float, p_error: float, estimates: np.ndarray, rollouts: float) -> Ratio:
    """Efficiency from the spread of repeated runs about the ground truth: p (1 - p) / rollouts over their mean squared
    error, bias and all. Chi-squared interval, widened for the error of p. Not known where the error is as large as p:
    always answering 0 would do as well."""
    n = estimates.size
    if n < 2 or not p > 0.0:
        return UNKNOWN
    error = float(np.mean((estimates - p) ** 2))
    if error == 0.0 or error >= p**2:
        return UNKNOWN
    value = p * (1.0 - p) / rollouts / error
    low, high = _chi_squared(n)
    spread = math.exp(Z * p_error)
    return Ratio(value, value * low / spread, value * high * spread)


def efficiency_of_spread(estimates: np.ndarray, rollouts: float) -> Ratio:
    """Efficiency from the spread of repeated runs about their own mean, for unbiased estimators where no better p is
    known: many runs together, whose mean is the estimate. Chi-squared interval, widened for the error of the mean. Not
    known where that error is as large as the mean."""
    n = estimates.size
    if n < 2 or not (p := float(estimates.mean())) > 0.0:
        return UNKNOWN
    error = float(estimates.var(ddof=1))
    if error == 0.0 or error / n >= p**2:
        return UNKNOWN
    value = p * (1.0 - p) / rollouts / error
    low, high = _chi_squared(n - 1)
    spread = math.exp(Z * math.sqrt(error / n) / p)
    return Ratio(value, value * low / spread, value * high * spread)


def _chi_squared(n: int) -> tuple[float, float]:
    """The 2.5% and 97.5% points of chi-squared with n degrees of freedom, over n."""
    return 2.0 * gammaincinv(n / 2.0, 0.025) / n, 2.0 * gammaincinv(n / 2.0, 0.975) / n
