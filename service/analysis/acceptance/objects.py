"""What is told of an acceptance case, as JSON objects."""

from typing import Literal

import msgspec

FORMAT = 1
Verdict = Literal["met", "not met", "undecided"]


class Term(msgspec.Struct, frozen=True, kw_only=True):
    """A scenario's part of a rate.

    p, ci: probability per rollout
    exposure, exposure_ci: rollouts per unit
    rate: their product
    rollouts: that the probability rests on; None where it is not known
    withheld: warnings for which the estimate cannot be relied on
    """

    scenario: str
    p: float
    ci: tuple[float, float]
    exposure: float
    exposure_ci: tuple[float, float]
    rate: float
    rollouts: int | None
    withheld: tuple[str, ...]


class Needed(msgspec.Struct, frozen=True, kw_only=True):
    """What it would take to decide, if more rollouts say the same.

    more: rollouts by scenario, in all; empty where no number of them decides
    says: in words
    """

    more: dict[str, int]
    says: str


class Judged(msgspec.Struct, frozen=True, kw_only=True):
    """A claim and its verdict.

    value, ci: the rate per unit or, against a human rate, how many times that; two-sided
    lower, upper: one-sided bounds, by which the verdict goes
    target: what the value may be at most
    """

    claim: str
    measure: str
    of_human: bool
    value: float | None
    ci: tuple[float, float | None]
    lower: float
    upper: float | None
    target: float
    verdict: Verdict
    why: str
    terms: tuple[Term, ...]
    human: str
    needed: Needed | None


class Acceptance(msgspec.Struct, frozen=True, kw_only=True):
    """A case and its verdicts. verdict: met where all claims are, not met where one is not."""

    format: int = FORMAT
    name: str
    unit: str
    confidence: float
    verdict: Verdict
    claims: tuple[Judged, ...]
