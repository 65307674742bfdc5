"""What a search learned, as JSON objects; `tailroad schema learned` prints their JSON Schema.

Numbers that are not known are null.
"""

from typing import Literal

import msgspec

FORMAT = 1


class Spread(msgspec.Struct, frozen=True, kw_only=True):
    """The distribution of one number: mean, standard deviation and quantiles."""

    mean: float
    sd: float
    q05: float
    q25: float
    q50: float
    q75: float
    q95: float


class Parameter(msgspec.Struct, frozen=True, kw_only=True):
    """A start (or weather, or cause of a driver's error) that is random in the scenario, under P0 and as the search
    has it.

    shift_sd: how far the mean has moved, in standard deviations under P0
    shift_sd_ci: its interval
    sentence: empty where the shift may be chance or is too small to matter
    """

    name: str
    vehicle: str  # "" for the weather
    kind: Literal[
        "position", "offset", "heading", "lateral speed", "speed", "weather", "reaction", "glance", "noise"
    ]
    unit: str
    base: Spread
    proposal: Spread | None
    shift_sd: float | None
    shift_sd_ci: tuple[float, float] | None
    sentence: str


class Rate(msgspec.Struct, frozen=True, kw_only=True):
    """A rate or a mean with its interval, from rollouts that were run again."""

    value: float | None
    low: float | None
    high: float | None


class Behaviour(msgspec.Struct, frozen=True, kw_only=True):
    """How the drivers drive, under P0 and as the search has them.

    sentence: empty where the two intervals meet
    """

    name: str
    what: str
    unit: str
    base: Rate
    proposal: Rate | None
    sentence: str


class Learned(msgspec.Struct, frozen=True, kw_only=True):
    """What the search of a job learned.

    source: what `proposal` stands for: the distribution that the search drew its last rollouts from (method ce), or
        the dangerous rollouts themselves, weighted so that they stand for P0 given the event; "none": there is
        neither yet
    effective: rollouts of equal weight that it rests on
    """

    format: int = FORMAT
    job: str
    iteration: int | None
    source: Literal["proposal", "dangerous rollouts", "none"]
    confidence: float
    effective: float | None
    rollouts_run_again: tuple[int, int]  # for the behaviours, under base and proposal
    parameters: tuple[Parameter, ...]
    behaviours: tuple[Behaviour, ...]
    summary: tuple[str, ...]  # the sentences, the largest shift first
    notes: tuple[str, ...]
