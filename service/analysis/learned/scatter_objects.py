"""Parameters against f, as JSON objects. Numbers that are not known are null."""

import msgspec

FORMAT = 1


class Axis(msgspec.Struct, frozen=True, kw_only=True):
    """A coordinate of X, or what the drivers of a rollout did.

    kind: position, speed, weather ..., or behaviour
    low, high: its smallest and largest value
    counts: rollouts of the sample, a row a cell of f and a column a cell of equal width between low and high; empty
        where it is known of the dangerous rollouts alone
    shift_sd: how far the mean of the dangerous rollouts lies from that of the sample, in its standard deviations
    """

    name: str
    kind: str
    unit: str
    low: float
    high: float
    counts: tuple[tuple[int, ...], ...]
    shift_sd: float | None


class Dangerous(msgspec.Struct, frozen=True, kw_only=True):
    """A dangerous rollout of the estimate.

    phase, iteration, row: where it was drawn
    share: of the estimate that it carries
    values: one an axis
    """

    phase: str
    iteration: int
    row: int
    f: float | None
    share: float
    values: tuple[float | None, ...]


class Scatter(msgspec.Struct, frozen=True, kw_only=True):
    """Parameters of a job's rollouts against f.

    recorded, sampled: rollouts on record, and those that are counted in cells, evenly spread over the record
    events: dangerous rollouts of the estimate, of which `dangerous` are shown
    f_edges: of the cells of f; the last one takes all above it, too
    run_again: of the dangerous rollouts, for what the drivers did in them
    """

    format: int = FORMAT
    job: str
    gamma: float
    unit: str
    recorded: int
    sampled: int
    events: int
    f_edges: tuple[float, ...]
    axes: tuple[Axis, ...]
    dangerous: tuple[Dangerous, ...]
    run_again: int
