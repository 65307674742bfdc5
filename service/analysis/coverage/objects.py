"""What is told of a run's coverage of the operational design domain, as JSON objects."""

import msgspec

from service.analysis.job_findings import JobFindings

FORMAT = 1


class Cell(msgspec.Struct, frozen=True, kw_only=True):
    """A cell of an attribute.

    mass, mass_ci: probability under P0, from draws
    rollouts, rollouts_share: of the run's that were looked at; None where they cannot be drawn again
    events, share, share_ci: dangerous rollouts, and the part of p that they carry; None where there is none at all
    times: the part of p over the mass: how many times as dangerous as all of P0; None where that is not known
    inside: whether a declared domain holds it; None without one
    """

    cell: str
    mass: float
    mass_ci: tuple[float, float]
    rollouts: int | None
    rollouts_share: float | None
    events: int
    share: float | None
    share_ci: tuple[float, float] | None
    times: float | None
    inside: bool | None = None


class Covered(msgspec.Struct, frozen=True, kw_only=True):
    """An attribute.

    cells: in order
    never_drawn: cells in which no draw of P0 lies: the scenario does not test them
    never_seen: cells that P0 draws, and no rollout lies in
    """

    attribute: str
    heading: str
    unit: str
    cells: tuple[Cell, ...]
    never_drawn: tuple[str, ...]
    never_seen: tuple[str, ...]


class Pair(msgspec.Struct, frozen=True, kw_only=True):
    """Cells of two attributes together that P0 draws and no rollout lies in, though each of them by itself holds some.
    mass: of P0, from draws."""

    attributes: tuple[str, str]
    cells: tuple[str, str]
    mass: float


class Coverage(JobFindings, frozen=True, kw_only=True):
    """How a job's rollouts cover the operational design domain.

    draws: of P0, that masses are counted on
    looked_at: rollouts of the run that cells are counted on, evenly spread over all of them
    events, examined: dangerous rollouts, and those that shares of p are counted on
    pairs, pairs_seen: cells of two attributes that P0 draws, and those of them with a rollout; None where not known
    pairs_never_seen: the likeliest first
    domain: name of the declared domain, "" without one
    missing: its cells, as attribute: cell, in which no rollout lies
    """

    format: int = FORMAT
    gamma: float
    unit: str
    confidence: float
    p: float | None
    draws: int
    looked_at: int
    events: int
    examined: int
    attributes: tuple[Covered, ...]
    pairs: int
    pairs_seen: int | None
    pairs_never_seen: tuple[Pair, ...]
    domain: str = ""
    missing: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
