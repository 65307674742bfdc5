"""How two estimates of p differ, with an interval that holds where events are few, too.

With many events, `ce.compare`: normal intervals, paired on common random numbers. With fewer than ENOUGH effective
events on a side, or none, a normal interval can be far too narrow (none at all: no width), and Bonferroni's bounds are
taken: both ends from intervals that hold together with the confidence asked for. On common random numbers with naive
Monte Carlo these are Clopper and Pearson's of the two counts of rollouts that were dangerous to one alone; else each
estimate's own interval.
"""

import math
from dataclasses import replace

import numpy as np

import ce
from ce.interval import clopper_pearson
from service.analysis.comparison.objects import Difference, Pairs

ENOUGH = 30.0  # effective events; ce's own warning "few-events" draws the line there


def difference_of(a: ce.Estimate, b: ce.Estimate) -> Difference:
    """p of b against p of a; raises ce.OptionsError where their confidences differ."""
    found = ce.compare(b, a)
    if min(a.ess, b.ess) >= ENOUGH:
        ratio = found.ratio if math.isfinite(found.ratio) else None
        return _difference(
            found.difference, found.difference_ci, ratio, found.ratio_ci, found.paired, "normal"
        )
    bounds = bounds_of((a.p, *_surer(a).ci), (b.p, *_surer(b).ci))
    pairs = pairs_of(a, b)
    if pairs is None:
        return bounds
    counts = np.array([pairs.only_b, pairs.only_a])
    (gained_low, lost_low), (gained_high, lost_high) = clopper_pearson(
        counts, a.f.size, 1.0 - 0.5 * (1.0 - a.confidence)
    )
    ci = float(gained_low - lost_high), float(gained_high - lost_low)
    ratio_ci = bounds.ratio_ci[0], math.inf if bounds.ratio_ci[1] is None else bounds.ratio_ci[1]
    return _difference(b.p - a.p, ci, bounds.ratio, ratio_ci, True, "paired counts")


def bounds_of(a: tuple[float, float, float], b: tuple[float, float, float]) -> Difference:
    """b against a, each (p, low, high): the furthest that the ends of both intervals allow."""
    (p_a, a_low, a_high), (p_b, b_low, b_high) = a, b
    ratio_ci = (b_low / a_high if a_high > 0 else 0.0, b_high / a_low if a_low > 0 else math.inf)
    ratio = p_b / p_a if p_a > 0 else None
    return _difference(p_b - p_a, (b_low - a_high, b_high - a_low), ratio, ratio_ci, False, "bounds")


def pairs_of(a: ce.Estimate, b: ce.Estimate) -> Pairs | None:
    """Who the same draws were dangerous to; None where the two did not run the same draws by naive Monte Carlo.

    A failed rollout counts as no event, and rules the pair out: None if there is any, because the interval must say so.
    """
    if a.log_weights is not None or b.log_weights is not None or a.seed != b.seed or a.f.size != b.f.size:
        return None
    if np.isnan(a.f).any() or np.isnan(b.f).any():
        return None
    in_a, in_b = a.f <= a.gamma, b.f <= b.gamma
    both, only_a, only_b = ((m).sum() for m in (in_a & in_b, in_a & ~in_b, in_b & ~in_a))
    return Pairs(
        both=int(both), only_a=int(only_a), only_b=int(only_b), neither=int(a.f.size - both - only_a - only_b)
    )


def _surer(estimate: ce.Estimate) -> ce.Estimate:
    """With half the chance to be wrong."""
    return replace(estimate, confidence=1.0 - 0.5 * (1.0 - estimate.confidence))


def _difference(
    difference: float,
    ci: tuple[float, float],
    ratio: float | None,
    ratio_ci: tuple[float, float],
    paired: bool,
    how: str,
) -> Difference:
    low, high = ci
    return Difference(
        difference=difference,
        difference_ci=ci,
        ratio=ratio,
        ratio_ci=(ratio_ci[0], ratio_ci[1] if math.isfinite(ratio_ci[1]) else None),
        paired=paired,
        how=how,
        clear=low > 0.0 or high < 0.0,
    )
