"""What is told of severity, as JSON objects. Seeds are text, because they have 64 bits."""

import msgspec

from service.analysis.failures.events import Order
from service.analysis.job_findings import MethodFindings
from service.analysis.severity.harm import Harm
from service.world.safety.contact import Contact

FORMAT = 1


class Likely(msgspec.Struct, frozen=True, kw_only=True):
    """A probability per rollout with its interval; events: the rollouts behind it, of those examined."""

    events: int
    p: float
    ci: tuple[float, float]


class AtLeast(Likely, frozen=True, kw_only=True):
    """A contact that changes the ego's velocity by this much or more."""

    delta_v_mps: float


class Injury(Likely, frozen=True, kw_only=True):
    """A serious injury (MAIS3+): the mean of the injury risk under the weights of the estimate.

    given_contact, given_contact_ci: risk of a contact, on average
    """

    given_contact: float
    given_contact_ci: tuple[float, float]


class Severe(msgspec.Struct, frozen=True, kw_only=True):
    """A contact.

    rank: as of `tailroad failures`
    iteration, row: where in the estimation it was drawn
    other: the vehicle hit; None: background traffic
    direction_deg: the other's velocity relative to the ego, from the ego's heading, counter-clockwise
    other_kg: mass that was reckoned with
    """

    rank: int
    iteration: int
    row: int
    noise_seed: str
    f: float
    share: float
    mode: str
    other: str | None
    contact: Contact
    direction_deg: float
    other_kg: float
    ego: Harm
    struck: Harm


class Severity(MethodFindings, frozen=True, kw_only=True):
    """How severe a job's contacts are.

    events: dangerous rollouts in the estimation
    examined: of them counted here
    from_record: whether their contacts were on record, and not found by running them again
    contact: probability of a contact of the ego
    at_least: of one with a change of the ego's velocity of so much or more
    injury, other_injury: of the ego's and of the other vehicle's occupants
    contacts: the severest first
    assumptions: what all this rests on
    notes: what bears on how far it can be relied on
    """

    format: int = FORMAT
    order: Order
    events: int
    examined: int
    from_record: bool = False
    contact: Likely
    at_least: tuple[AtLeast, ...]
    injury: Injury
    other_injury: Injury
    masses_kg: dict[str, float]
    contacts: tuple[Severe, ...]
    assumptions: tuple[str, ...]
    notes: tuple[str, ...]
