"""How the drivers drive under P0 and as the search has them: rates with intervals, from rollouts that were run again.

A rate is a ratio of sums over rollouts, as in lane changes over kilometres, each rollout with its weight. Rollouts are
independent, what happens within one is not, so the variance is the linearised one of the ratio over rollouts. Counts
may be few, or none: their interval is Fay and Feuer's (Statistics in Medicine 16, 1997), made for weighted counts and
exact for equal ones. Means have Student's.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import chdtri, stdtrit

from service.analysis.failures.driving import CLOSE_S, HARD_BRAKE_MPS2, Driving
from service.analysis.learned.objects import Behaviour, Rate
from service.analysis.learned.parameters import LEAST_EFFECTIVE
from service.analysis.learned.words import rate_sentence


@dataclass(frozen=True)
class Kind:
    """A rate: above over below, times `scale`.

    counted: of events that may be few
    says: for more and for less
    """

    name: str
    what: str
    unit: str
    above: str
    below: str
    counted: bool
    says: tuple[str, str]
    scale: float = 1.0


KINDS = (
    Kind("lane_changes", "lane changes", "per vehicle-km", "lane_changes", "km", True,
         ("the drivers change lanes more often", "the drivers change lanes less often")),
    Kind("hard_brakes", f"brakings of {HARD_BRAKE_MPS2:g} m/s² and harder", "per vehicle-km", "hard_brakes", "km", True,
         ("the drivers brake hard more often", "the drivers brake hard less often")),
    Kind("close_following", f"time within {CLOSE_S:g} s behind another", "% of driving", "close", "states", False,
         ("the drivers follow closely for longer", "the drivers follow closely for less time"), 100.0),
    Kind("headway", "mean time headway of those that follow another vehicle", "s", "headway_s", "following", False,
         ("the drivers keep longer headways", "the drivers keep shorter headways")),
    Kind("speed", "mean speed", "m/s", "speed_mps", "states", False,
         ("the drivers drive faster", "the drivers drive slower")),
)  # fmt: skip


@dataclass(frozen=True)
class Driven:
    """How the drivers of n rollouts drove, each with its weight.

    ess: their effective number
    """

    driving: Sequence[Driving]
    weight: np.ndarray
    ess: float


def behaviours_of(base: Driven, proposal: Driven | None, confidence: float) -> list[Behaviour]:
    """Every rate under both; a sentence where the two intervals lie apart, each of enough rollouts."""
    found = []
    for kind in KINDS:
        before = rate_of(kind, base, confidence)
        after = None if proposal is None else rate_of(kind, proposal, confidence)
        sentence = ""
        told = proposal is not None and min(base.ess, proposal.ess) >= LEAST_EFFECTIVE
        if after is not None and told and _apart(before, after):
            sentence = rate_sentence(kind.says, kind.unit, before, after)
        found.append(
            Behaviour(
                name=kind.name,
                what=kind.what,
                unit=kind.unit,
                base=before,
                proposal=after,
                sentence=sentence,
            )
        )
    return found


def rate_of(kind: Kind, driven: Driven, confidence: float) -> Rate:
    """The rate with its interval; nothing of it where nothing was driven."""
    above = np.array([getattr(d, kind.above) for d in driven.driving], dtype=np.float64)
    below = np.array([getattr(d, kind.below) for d in driven.driving], dtype=np.float64)
    total = float(driven.weight @ below) if below.size else 0.0
    if total <= 0.0:
        return Rate(value=None, low=None, high=None)
    share = driven.weight / total
    rate = float(share @ above)
    n = driven.ess
    if n < 2.0:
        return Rate(value=kind.scale * rate, low=None, high=None)
    spread = np.sum((share * (above - rate * below)) ** 2) * n / (n - 1.0)
    tail = 0.5 * (1.0 - confidence)
    if kind.counted:
        low, high = _counted(
            rate, max(float(spread), float(np.sum(share**2 * above))), float(share.max()), tail
        )
    else:
        half = float(stdtrit(n - 1.0, 1.0 - tail)) * math.sqrt(float(spread))
        low, high = max(rate - half, 0.0), rate + half
    return Rate(value=kind.scale * rate, low=kind.scale * low, high=kind.scale * high)


def _counted(rate: float, variance: float, one: float, tail: float) -> tuple[float, float]:
    """Fay and Feuer's interval.

    one: what a single further event in the heaviest rollout would add to the rate
    """
    low = 0.0
    if rate > 0.0:
        low = variance / (2.0 * rate) * float(chdtri(2.0 * rate**2 / variance, 1.0 - tail))
    more, wider = rate + one, variance + one**2
    return low, wider / (2.0 * more) * float(chdtri(2.0 * more**2 / wider, tail))


def _apart(a: Rate, b: Rate) -> bool:
    if a.low is None or a.high is None or b.low is None or b.high is None:
        return False
    return a.high < b.low or b.high < a.low
