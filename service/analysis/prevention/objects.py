"""What is told of preventability, as JSON objects. Seeds are text, because they have 64 bits."""

import msgspec

from service.analysis.failures.events import Order
from service.analysis.job_findings import MethodFindings
from service.analysis.prevention.onset import Onset

FORMAT = 1


class Part(msgspec.Struct, frozen=True, kw_only=True):
    """A part of p.

    events: dangerous rollouts in it, of those driven again
    share, share_ci: of p
    p, ci: probability that a rollout is dangerous in this way
    """

    events: int
    share: float
    share_ci: tuple[float, float]
    p: float
    ci: tuple[float, float]


class OfMode(msgspec.Struct, frozen=True, kw_only=True):
    """A failure mode: what part of it a reference driver prevents.

    share, share_ci: of the mode's p that is preventable
    """

    mode: str
    name: str
    events: int
    prevented: int
    share: float
    share_ci: tuple[float, float]
    preventable: Part
    unpreventable: Part


class ByReference(msgspec.Struct, frozen=True, kw_only=True):
    """p = preventable + unpreventable, by one reference driver.

    reference: its name
    says: what it is, with its source; empty for an ego
    outcomes: how the rollouts ended with it at the wheel
    failed: rollouts that it could not be driven in: they count as unpreventable
    """

    reference: str
    says: str
    preventable: Part
    unpreventable: Part
    modes: tuple[OfMode, ...]
    outcomes: dict[str, int]
    failed: int


class Driven(msgspec.Struct, frozen=True, kw_only=True):
    """What a dangerous rollout came to with a reference driver.

    f: None where it failed
    prevented: whether f is above gamma
    """

    f: float | None
    outcome: str
    prevented: bool
    error: str | None = None


class Prevented(msgspec.Struct, frozen=True, kw_only=True):
    """A dangerous rollout, and what each reference driver makes of it.

    rank: as of `tailroad failures`
    iteration, row: where in the estimation it was drawn
    f: on record
    share: of the estimate that it carries
    mode: its failure mode
    other: the vehicle of the conflict; None: background traffic
    onset: None where the rollout could not be run again
    """

    rank: int
    iteration: int
    row: int
    noise_seed: str
    f: float
    same_to_the_bit: bool
    outcome: str
    share: float
    mode: str
    other: str | None
    onset: Onset | None
    driven: dict[str, Driven]


class Prevention(MethodFindings, frozen=True, kw_only=True):
    """What part of p a reference driver would have prevented.

    onset_ttc_s: a conflict begins when the boxes would touch within this time; None: with the rollout
    bridged_s: gaps of up to this do not end a conflict
    events: dangerous rollouts in the estimation
    examined: of them driven again
    notes: what bears on how far this can be relied on
    """

    format: int = FORMAT
    p: float | None
    ci: tuple[float, float]
    order: Order
    onset_ttc_s: float | None
    bridged_s: float
    events: int
    examined: int
    references: tuple[ByReference, ...]
    rollouts: tuple[Prevented, ...]
    notes: tuple[str, ...]
