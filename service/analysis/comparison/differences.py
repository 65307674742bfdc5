"""How two estimates of p differ, with an interval that holds where events are few, too.

With many events, `ce.compare`: normal intervals, paired on common random numbers. With fewer than ENOUGH effective
events on a side, or none, a normal interval can be far too narrow (none at all: no width), and Bonferroni's bounds are
taken: both ends from intervals that hold together with the confidence asked for. On common random numbers with naive
Monte Carlo these are Clopper and Pearson's of the counts below; else each estimate's own interval.

On the same draws only those that were dangerous to one alone tell the two apart (McNemar, Psychometrika 12, 1947). Let
s be B's share of these, r their rate and b the share of those dangerous to both in all that were to any. Then

    p_B - p_A = (2 s - 1) r,     p_B / p_A = (b + s (1 - b)) / (b + (1 - s) (1 - b)),

and 0 and 1 are left out where the interval of s leaves out 1/2, which is McNemar's exact test.
"""

import math
from dataclasses import replace

import numpy as np
from scipy.special import bdtr

import ce
from ce.interval import clopper_pearson
from service.analysis.comparison.objects import Difference, Pairs

MCNEMAR = 0.9  # of the chance to be wrong, that the share s has; r and b have the rest each where they count
ENOUGH = 30.0  # effective events; ce's own warning "few-events" draws the line there


def difference_of(a: ce.Estimate, b: ce.Estimate) -> Difference:
    """p of b against p of a; raises ce.OptionsError where their confidences differ."""
    found = ce.compare(b, a)
    if min(a.ess, b.ess) >= ENOUGH:
        ratio = found.ratio if math.isfinite(found.ratio) else None
        return _difference(
            found.difference, found.difference_ci, ratio, found.ratio_ci, found.paired, "normal"
        )
    pairs = pairs_of(a, b)
    if pairs is not None:
        return of_pairs(pairs, a.confidence)
    return bounds_of((a.p, *_surer(a).ci), (b.p, *_surer(b).ci))


def of_pairs(pairs: Pairs, confidence: float) -> Difference:
    """From how many of the same draws were dangerous to whom; exact for any counts."""
    alone = pairs.only_a + pairs.only_b
    n = pairs.both + alone + pairs.neither
    beside = 1.0 - (1.0 - MCNEMAR) * (1.0 - confidence)
    s = _share(pairs.only_b, alone, 1.0 - MCNEMAR * (1.0 - confidence))
    r = _share(alone, n, beside)
    b = _share(pairs.both, pairs.both + alone, beside)

    def difference(share: float, rate: float) -> float:
        return (2.0 * share - 1.0) * rate

    def ratio(share: float, both: float) -> float:
        below = both + (1.0 - share) * (1.0 - both)
        return (both + share * (1.0 - both)) / below if below > 0.0 else math.inf

    more, less = (
        s[0] > 0.5,
        s[1] < 0.5,
    )  # how far from 1/2 each end is decides which ends of r and b go with it
    ci = difference(s[0], r[0] if more else r[1]), difference(s[1], r[0] if less else r[1])
    ratio_ci = ratio(s[0], b[1] if more else b[0]), ratio(s[1], b[1] if less else b[0])
    of_a, of_b = pairs.both + pairs.only_a, pairs.both + pairs.only_b
    found = of_b / of_a if of_a else None
    return _difference((pairs.only_b - pairs.only_a) / n, ci, found, ratio_ci, True, "paired counts")


def _share(count: int, n: int, confidence: float) -> tuple[float, float]:
    low, high = clopper_pearson(count, n, confidence)
    return float(low), float(high)


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
        both=int(both),
        only_a=int(only_a),
        only_b=int(only_b),
        neither=int(a.f.size - both - only_a - only_b),
        p_value=mcnemar(int(only_a), int(only_b)),
    )


def mcnemar(only_a: int, only_b: int) -> float:
    """McNemar's exact p-value, two-sided: how often chance alone would split those dangerous to one at least so
    unevenly.

    >>> f"{mcnemar(8, 24):.3f}"
    '0.007'
    """
    return min(1.0, 2.0 * float(bdtr(min(only_a, only_b), only_a + only_b, 0.5)))


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
