"""What is told of a comparison, as JSON objects; `tailroad schema comparison` prints their JSON Schema."""

import msgspec

FORMAT = 1


class Side(msgspec.Struct, frozen=True, kw_only=True):
    """One of the two: A is what is compared against, B what is new."""

    name: str
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

    how: "normal" (ce.compare), "paired counts" or "bounds" (service.comparison.differences), the exact ones where
    events are few. clear: the interval of the difference leaves 0 out.
    """

    difference: float  # p of B minus p of A
    difference_ci: tuple[float, float]
    ratio: float | None  # p of B over p of A
    ratio_ci: tuple[float, float | None]  # None: no upper end
    paired: bool  # both ran the same draws
    how: str
    clear: bool


class Pairs(msgspec.Struct, frozen=True, kw_only=True):
    """The same draws run by both: how many were dangerous to whom."""

    both: int
    only_a: int
    only_b: int
    neither: int


class ModeSide(msgspec.Struct, frozen=True, kw_only=True):
    """A failure mode in one of the two."""

    events: int
    p: float
    ci: tuple[float, float]


class ModeChange(msgspec.Struct, frozen=True, kw_only=True):
    """A failure mode in both. change: "appeared" (none in A), "vanished" (none in B), "more", "less", or "unclear"."""

    mode: str
    name: str
    a: ModeSide
    b: ModeSide
    difference: Difference
    change: str


class Curves(msgspec.Struct, frozen=True, kw_only=True):
    """p of both against the threshold, with pointwise intervals."""

    gamma: tuple[float, ...]
    a: tuple[float, ...]
    a_low: tuple[float, ...]
    a_high: tuple[float, ...]
    b: tuple[float, ...]
    b_low: tuple[float, ...]
    b_high: tuple[float, ...]


class Comparison(msgspec.Struct, frozen=True, kw_only=True):
    """Two egos or two runs on the same question."""

    format: int = FORMAT
    gamma: float
    confidence: float
    a: Side
    b: Side
    difference: Difference
    pairs: Pairs | None  # where both ran the same draws by naive Monte Carlo
    modes: tuple[ModeChange, ...]  # the largest change of p first
    curves: Curves
    said: str
    notes: tuple[str, ...]
