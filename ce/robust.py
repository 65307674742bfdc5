"""When P0 is wrong: the same rollouts under another base distribution, the slope of p, and the worst case nearby."""

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import brentq
from scipy.special import ndtri, xlogy

from ce.errors import FamilyError, OptionsError, ResponseError
from ce.estimate_warnings import DOMINANT_SHARE, FEW_EVENTS, HEAVY_TAIL
from ce.product import Product
from ce.replicated import ReplicatedEstimate
from ce.results import Estimate

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Sensitivity:
    """d p / d theta in the base's natural parameters, in the order of `Product.natural`; all arrays (s,).

    derivative: estimate of each
    std_error: its standard error
    low: lower end of its interval
    high: upper end of its interval
    """

    derivative: Array
    std_error: Array
    low: Array
    high: Array


def reweighted(est: Estimate, base: Product, other: Product, x_events: ArrayLike) -> Estimate:
    """The estimate of P1(f(X) <= gamma) for another base P1 of the same family, from the events of `est`.

    Raises OptionsError, saying by how much, where the events at hand do not carry the other base: fewer than FEW_EVENTS
    effective ones, one with more than DOMINANT_SHARE of the weight, or a Pareto k above HEAVY_TAIL. Only p at gamma
    means something in the result, not the rest of its curve.

    est: of P0(f(X) <= gamma), not by splitting
    base: distribution P0
    other: distribution P1
    x_events: (events, d), the rollouts with f <= gamma in their order (`np.flatnonzero(est.f <= est.gamma)`)

    >>> import ce
    >>> base, other = (ce.Product([ce.Normal([mean], [[1.0]])]) for mean in (0.0, 0.2))
    >>> est = ce.estimate(lambda x: 1.5 - x[:, 0], base, gamma=0.0, method="naive", budget=5000, seed=1)
    >>> x, _ = ce.draw(base, 1, "estimate", 0, 0, 5000)
    >>> moved = ce.reweighted(est, base, other, x[est.f <= 0.0])
    >>> moved.ci[0] < 0.0968 < moved.ci[1]
    True
    """
    rows, x = _events(est, x_events)
    old = np.zeros(est.f.size) if est.log_weights is None else est.log_weights
    log_weights = np.full(est.f.size, -math.inf)
    log_weights[rows] = old[rows] + other.log_ratio(base, x)
    log_weights[np.isnan(est.f)] = old[np.isnan(est.f)]
    found = replace(est, log_weights=log_weights, base_f=np.zeros(0), rel_error=None)
    if (
        found.ess < FEW_EVENTS
        or found.max_weight_share > DOMINANT_SHARE
        or (not math.isnan(found.pareto_k) and found.pareto_k > HEAVY_TAIL)
    ):
        raise OptionsError(
            f"the events at hand do not carry the other base: worth {found.ess:.1f} of equal weight (at least "
            f"{FEW_EVENTS:g} needed), the largest {found.max_weight_share:.0%} of the weight, Pareto k "
            f"{found.pareto_k:.2f}; choose a nearer base, or run the estimate under it"
        )
    return found


def sensitivity(est: Estimate, base: Product, x_events: ArrayLike) -> Sensitivity:
    """How p changes with the base's natural parameters: E[w 1{f <= gamma} (Gamma(X) - grad A)], the score method.

    est: of P0(f(X) <= gamma), not by splitting
    base: distribution P0
    x_events: (events, d), the rollouts with f <= gamma in their order

    >>> import ce
    >>> base = ce.Product([ce.Normal([0.0], [[1.0]])])
    >>> est = ce.estimate(lambda x: 1.5 - x[:, 0], base, gamma=0.0, method="naive", budget=5000, seed=1)
    >>> x, _ = ce.draw(base, 1, "estimate", 0, 0, 5000)
    >>> found = ce.sensitivity(est, base, x[est.f <= 0.0])
    >>> bool(found.low[0] < 0.1295 < found.high[0])  # the density at 1.5
    True
    """
    rows, x = _events(est, x_events)
    w = np.ones(rows.size) if est.log_weights is None else np.exp(est.log_weights[rows])
    terms = w[:, None] * (base.statistics(x) - base.mean_statistics())
    n = est.f.size
    derivative = terms.sum(axis=0) / n
    variance = np.maximum(np.sum(terms**2, axis=0) / n - derivative**2, 0.0) / max(n - 1, 1)
    half = float(ndtri(0.5 + 0.5 * est.confidence)) * np.sqrt(variance)
    return Sensitivity(derivative, np.sqrt(variance), derivative - half, derivative + half)


def worst_case(p: float, radius: float) -> float:
    """The largest Q(A) over all Q with KL(Q || P0) <= radius, for an event with P0(A) = p.

    The worst Q tilts P0 by the event alone, so q solves q log(q / p) + (1 - q) log((1 - q) / (1 - p)) = radius.
    Raises OptionsError for other input than said here.

    p: in [0, 1]; the upper end of an interval for a bound that holds with its confidence
    radius: in nats, not negative

    >>> import ce
    >>> f"{ce.worst_case(1e-3, radius=0.01):.5f}"
    '0.00816'
    """
    if not 0.0 <= p <= 1.0:
        raise OptionsError(f"p must lie in [0, 1], not {p!r}")
    if not (radius >= 0.0 and math.isfinite(radius)):
        raise OptionsError(f"radius must be finite and not negative, not {radius!r}")
    if p in (0.0, 1.0) or radius == 0.0:
        return p
    if radius >= -math.log(p):
        return 1.0

    def excess(q: float) -> float:
        return float(xlogy(q, q / p) + xlogy(1.0 - q, (1.0 - q) / (1.0 - p))) - radius

    return float(brentq(excess, p, 1.0, xtol=1e-300, rtol=1e-12))


def _events(est: Estimate, x_events: ArrayLike) -> tuple[NDArray[np.intp], Array]:
    if isinstance(est, ReplicatedEstimate):
        raise OptionsError("the rollouts of splitting cannot be reweighted; use method mixture")
    rows = np.flatnonzero(est.f <= est.gamma)
    x = np.asarray(x_events, dtype=np.float64)
    if x.ndim != 2:
        raise FamilyError(f"x_events must have shape (events, d), not {x.shape}")
    if x.shape[0] != rows.size:
        raise ResponseError(
            f"x_events must hold the {rows.size} events of the estimate, not {x.shape[0]} rows"
        )
    return rows, x
