"""From a contact and two masses to the change of velocity, and from that to the risk of injury."""

import math

import msgspec

from service.world.safety.contact import Contact

# P(MAIS3+) = 1 / (1 + exp(C0 - C1 dv - k)), dv in m/s: the reduced logistic regression with impact areas of the harm
# parameters that TUM's risk-aware planners publish (LR4S; Geisslinger et al. 2023, Nature Machine Intelligence 5)
C0, C1 = 4.457, 0.177
AREAS = {"front": 0.0, "side": 0.244, "rear": -0.431}
# Where side meets side the vehicles slide along each other (impact mechanics after Brach 2005): of the velocity across
# the sides a part comes back, and along them no more is lost than friction takes.
RESTITUTION = 0.2
FRICTION = 0.5


class Harm(msgspec.Struct, frozen=True, kw_only=True):
    """What a contact does to one of its two vehicles.

    area: where it is hit: front, side or rear
    delta_v_mps: change of its velocity
    injury: probability that an occupant is injured seriously or worse (MAIS3+)
    """

    area: str
    delta_v_mps: float
    injury: float


def injury_risk(delta_v_mps: float, area: str) -> float:
    """P(MAIS3+) for a change of velocity (m/s) and the area hit: "front", "side" or "rear".

    >>> [round(injury_risk(15.0, area), 3) for area in ("front", "side", "rear")]
    [0.142, 0.174, 0.097]
    """
    return 1.0 / (1.0 + math.exp(C0 - C1 * delta_v_mps - AREAS[area]))


def area_of(side: str) -> str:
    """The area of a side of the box."""
    return "side" if side in ("left", "right") else side


def exchanged_mps(contact: Contact) -> float:
    """The part of the relative velocity (m/s) that the two vehicles exchange: their velocities' changes add up to it.

    All of it where a front or a rear takes part: a plastic impact, after which both move as one. Where side meets
    side, (1 + RESTITUTION) times what is across the sides, and along them at most FRICTION times that.
    """
    if area_of(contact.ego_side) != "side" or area_of(contact.other_side) != "side":
        return contact.speed_mps
    across = (1.0 + RESTITUTION) * abs(contact.left_mps)
    along = min(abs(contact.ahead_mps), FRICTION * across)
    return math.sqrt(across * across + along * along)


def harms_of(contact: Contact, ego_kg: float, other_kg: float) -> tuple[Harm, Harm]:
    """What the contact does to the ego and to the other: delta-v = m_other / (m_ego + m_other) times what they
    exchange, and the same the other way round."""
    exchanged = exchanged_mps(contact)
    both = ego_kg + other_kg
    return (
        _harm(contact.ego_side, other_kg / both * exchanged),
        _harm(contact.other_side, ego_kg / both * exchanged),
    )


def _harm(side: str, delta_v_mps: float) -> Harm:
    area = area_of(side)
    return Harm(area=area, delta_v_mps=delta_v_mps, injury=injury_risk(delta_v_mps, area))
