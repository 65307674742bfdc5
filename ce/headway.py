"""How far a search is ahead of naive Monte Carlo at the levels it has come to, and whether that leads anywhere.

Told from few batches, long before the search reaches gamma: where the proposals are good, each is far ahead of the base
at the level that it was fitted to, and where they are not, none is (decision 97).
"""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

TELLING = 0.15  # probability of a level, above which no proposal can be far ahead of the base there
# Of the budget, from which a search may have stalled. Its last two batches are
STALLED_FROM = 0.2
HEADWAY = 0.4  # not as far ahead as this
RISING = 0.1  # and do not rise by this from one to the other,
LOOKED = 0.3  # or it was held up before the look, and the first batch after it is not as far ahead as this.

Array = NDArray[np.float64]


def headway(f: Array, log_w: Array, level: float) -> float:
    """How far the proposal of a batch, with f (n,) and log weights, was ahead of the base at the level it was fitted
    to: log of the effective events a rollout over those of naive Monte Carlo, by -log P0(f <= level). 0: no better
    than the base; 1: every rollout an event of its own. NaN where the level says nothing yet."""
    w = np.exp(log_w[f <= level])
    p = float(w.sum()) / f.size
    if not level < math.inf or not 0.0 < p <= TELLING:
        return math.nan
    return math.log(float(w.sum()) / float(w @ w)) / -math.log(p)


def stalled(ahead: Sequence[float], spent: float, since_look: int | None = None) -> bool:
    """Whether a search's proposals are hardly ahead of the base, and not getting further ahead, though a fair share of
    the budget is spent. ahead: `MixtureState.headway`, NaN where a level tells nothing yet; since_look: batches after
    the look, None where there was none. The first of them says what the look has helped."""
    if spent < STALLED_FROM or len(ahead) < 2 or since_look == 0:
        return False
    before, last = ahead[-2:]
    if since_look == 1:  # where it was well ahead before, what the look has added is soon weeded out
        return last < LOOKED and not before >= HEADWAY
    return max(before, last) < HEADWAY and last < before + RISING  # never where one is NaN


def led(ahead: Sequence[float]) -> bool:
    """Whether the last proposal that tells is well ahead of the base, as `stalled` judges it."""
    told = [h for h in ahead if not math.isnan(h)]
    return bool(told) and told[-1] >= HEADWAY
