"""What is told of a job's failures, as JSON objects; `tailroad schema failures` prints their JSON Schema.

Numbers that are not known are null. Seeds are text, because they have 64 bits.
"""

import msgspec

from service.analysis.failures.events import Order
from service.analysis.failures.lapses import Lapse
from service.analysis.failures.motion import Motion
from service.analysis.job_findings import MethodFindings
from service.world.safety.contact import Contact

FORMAT = 2


class Failure(msgspec.Struct, frozen=True, kw_only=True):
    """A dangerous rollout, run once more."""

    rank: int  # 1 is the first in the order asked for
    iteration: int  # with row: where in the estimation it was drawn
    row: int
    noise_seed: str
    f: float  # on record
    f_again: float | None  # when it was run once more
    same_to_the_bit: bool
    outcome: str
    error: str | None  # why it could not be run once more
    log_likelihood: float  # log p0(x), nats
    starts_log_likelihood: float  # of the vehicles' starts alone, nats
    weight: float  # p0(x) over the proposal's density
    share: float  # of the estimate that this rollout carries
    mode: str
    kind: str | None  # by the rules, for this rollout alone
    other: str | None  # the vehicle that the smallest value is to; None: background traffic
    motion: Motion | None
    # by vehicle: station_m, lane_offset_m, heading_deg or lateral_mps, speed_mps
    starts: dict[str, dict[str, float]]
    causes: dict[str, dict[str, float]] = {}  # by vehicle: what makes its driver err, as drawn
    contact: Contact | None = None  # of the ego, where it ended the rollout
    lapse: Lapse | None = None  # of the other vehicle's driver, where drivers have any
    story: str = ""  # what came together, in one sentence


class Mode(msgspec.Struct, frozen=True, kw_only=True):
    """A way to fail."""

    mode: str
    name: str
    typical: str  # how it usually goes, in one sentence
    events: int  # of the rollouts examined
    share: float  # of p
    share_ci: tuple[float, float]
    p: float  # probability that a rollout is dangerous in this way
    ci: tuple[float, float]
    agreement: float  # share of its rollouts that the rules alone name so
    example: Failure  # the first of its rollouts in the order asked for


class Cause(msgspec.Struct, frozen=True, kw_only=True):
    """A cause on the other driver's side, and what part of p it has; every dangerous rollout has one of them."""

    cause: str
    name: str
    events: int  # of the rollouts examined
    share: float  # of p
    share_ci: tuple[float, float]
    p: float
    ci: tuple[float, float]
    rank: int  # of an example, the first in the order asked for
    story: str  # of the example, in one sentence


class Modes(MethodFindings, frozen=True, kw_only=True):
    """The ways in which a job's ego fails."""

    format: int = FORMAT
    p: float | None
    ci: tuple[float, float]
    order: Order
    events: int  # dangerous rollouts in the estimation
    examined: int  # of them run once more and grouped
    modes: tuple[Mode, ...]  # the likeliest first
    notes: tuple[str, ...]  # what bears on how far this can be relied on
    outcome: str = ""  # where the rollouts are those that ended so, and not those with f <= gamma
    causes: tuple[
        Cause, ...
    ] = ()  # on the other driver's side, the likeliest first; none where drivers cannot err


class Failures(Modes, frozen=True, kw_only=True):
    """How a job's ego fails."""

    failures: tuple[Failure, ...]  # the first in the order asked for
