"""A comparison as JSON objects; `tailroad schema comparison` prints their JSON Schema.

In a pair, A is what is compared against and B what is new.
"""

import msgspec

FORMAT = 2


class Side(msgspec.Struct, frozen=True, kw_only=True):
    """One of those that are compared."""

    name: str  # the ego's, or the run's where several have the same ego
    run: str
    scenario: str
    ego: str
    method: str
    seed: int
    rollouts: int
    events: int
    ess: float
    p: float | None
    std_error: float | None
    ci: tuple[float, float]
    warnings: tuple[str, ...]  # names


class Difference(msgspec.Struct, frozen=True, kw_only=True):
    """p of B against p of A.

    how: "normal" (ce.compare), "paired counts" or "bounds" (service.analysis.comparison.differences), the exact ones
        where events are few
    clear: the interval of the difference leaves 0 out
    """

    difference: float  # p of B minus p of A
    difference_ci: tuple[float, float]
    ratio: float | None  # p of B over p of A
    ratio_ci: tuple[float, float | None]  # None: no upper end
    paired: bool  # both ran the same draws
    how: str
    clear: bool


class Pairs(msgspec.Struct, frozen=True, kw_only=True):
    """The same draws run by both: how many were dangerous to whom.

    p_value: of McNemar's exact test, two-sided, that only_a and only_b differ by chance alone
    """

    both: int
    only_a: int
    only_b: int
    neither: int
    p_value: float | None = None


class ModeSide(msgspec.Struct, frozen=True, kw_only=True):
    """A failure mode in one of the two."""

    events: int
    p: float
    ci: tuple[float, float]


class ModeChange(msgspec.Struct, frozen=True, kw_only=True):
    """A failure mode in both.

    change: "unclear" where the interval of the difference of p holds 0, whatever was met; else "appeared" (none in
        A), "vanished" (none in B), "more" or "less"
    """

    mode: str
    name: str
    a: ModeSide
    b: ModeSide
    difference: Difference
    change: str


class Pair(msgspec.Struct, frozen=True, kw_only=True):
    """Side `b` (its place in `sides`) against side `a`: difference and ratio of p, and the ways to fail that came and
    went.

    draws: where both ran the same ones by naive Monte Carlo
    """

    a: int
    b: int
    difference: Difference
    draws: Pairs | None
    modes: tuple[ModeChange, ...]  # the largest change of p first
    summary: str = ""
    said: str  # summary by its old name


class Line(msgspec.Struct, frozen=True, kw_only=True):
    """p of one side at each threshold of the curves, with pointwise intervals."""

    p: tuple[float | None, ...]
    low: tuple[float, ...]
    high: tuple[float, ...]


class Curves(msgspec.Struct, frozen=True, kw_only=True):
    """p of all sides, in their order, against the threshold."""

    gamma: tuple[float, ...]
    sides: tuple[Line, ...]


class Comparison(msgspec.Struct, frozen=True, kw_only=True):
    """Egos or runs on the same question.

    pairs: each against each that stands before it
    """

    format: int = FORMAT
    gamma: float
    unit: str = ""  # of gamma
    confidence: float
    sides: tuple[Side, ...]
    pairs: tuple[Pair, ...]
    curves: Curves
    notes: tuple[str, ...]
