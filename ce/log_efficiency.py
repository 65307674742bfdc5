"""Logarithmic efficiency: how far a search's proposals are ahead of naive Monte Carlo, and whether that leads anywhere.

An importance sampler whose terms have mean p and second moment m2 is judged, for rare events, by log m2 / log p: 1 for
naive Monte Carlo, 2 at best (Asmussen and Glynn, Stochastic Simulation, Springer 2007, section VI.1). Here it is taken
less 1, so that 0 is naive Monte Carlo and 1 an optimal proposal, and at the level that a proposal was fitted to. It is
told from few batches, long before the search reaches gamma: where the proposals are good, each is far ahead of the base
at its level, and where they are not, none is (deploy/decisions/0097-searches-that-stall.md).
"""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

# Probability of a level, above which no proposal can be far ahead of the base there.
LARGEST_P = 0.15
# Share of the budget from which a search may have stalled.
STALLED_FROM = 0.2
# It has where its last two batches are below this
WELL_AHEAD = 0.4
# and do not rise by this from one to the other,
RISING = 0.1
# or where it was held up before the mode search and the first batch after that is below this.
HELPED = 0.3

Array = NDArray[np.float64]


def log_efficiency(f: Array, log_w: Array, level: float) -> float:
    """log m2 / log p - 1 of {f <= level} by a batch, NaN where the level says nothing yet.

    It is also the logarithm of the effective events a rollout over those of naive Monte Carlo, divided by -log p.

    f: (n,), values of the batch
    log_w: (n,), log weights base / proposal
    level: that the proposal was fitted to, in the unit of f
    """
    w = np.exp(log_w[f <= level])
    p = float(w.sum()) / f.size
    if not level < math.inf or not 0.0 < p <= LARGEST_P:
        return math.nan
    return math.log(float(w.sum()) / float(w @ w)) / -math.log(p)


def stalled(efficiencies: Sequence[float], spent: float, since_mode_search: int | None = None) -> bool:
    """Whether a search's proposals are hardly ahead of the base and do not get further, late enough in the budget.

    efficiencies: `log_efficiency` of each batch, NaN where a level tells nothing yet
    spent: share of the budget
    since_mode_search: batches since then, None where there was none; the first of them says what it has helped
    """
    if spent < STALLED_FROM or len(efficiencies) < 2 or since_mode_search == 0:
        return False
    before, last = efficiencies[-2:]
    if since_mode_search == 1:  # where it was well ahead before, what was added is soon weeded out
        return last < HELPED and not before >= WELL_AHEAD
    return max(before, last) < WELL_AHEAD and last < before + RISING  # never where one is NaN


def well_ahead(efficiencies: Sequence[float]) -> bool:
    """Whether the last proposal that tells is well ahead of the base, as `stalled` judges it."""
    known = [h for h in efficiencies if not math.isnan(h)]
    return bool(known) and known[-1] >= WELL_AHEAD
