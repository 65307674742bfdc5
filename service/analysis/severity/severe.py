"""From examined rollouts to p(contact), p(delta-v >= v) and p(MAIS3+), all by the same weights."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from service.analysis.failures.events import Events, Order
from service.analysis.failures.examine import Examined, Watch, examine, look_away, modes_by_position
from service.analysis.failures.find import notes_on
from service.analysis.failures.question import question_of
from service.analysis.failures.rerun import Rerunner
from service.analysis.failures.shares import mean_interval
from service.analysis.failures.tell import mean_p, mode_p, mode_share
from service.analysis.severity.harm import Harm, harms_of
from service.analysis.severity.masses import CLASSES, class_of, masses_of
from service.analysis.severity.objects import AtLeast, Injury, Likely, Severe, Severity
from service.world.safety.contact import Contact
from service.world.scenario.measures import IMPACT

SPEEDS_MPS = (5.0, 10.0)
LISTED = 20


@dataclass(frozen=True)
class _Hit:
    contact: Contact
    other: str | None
    other_kg: float
    ego: Harm
    struck: Harm


def severity_of(
    run: str,
    examined: Examined,
    order: Order = "likelihood",
    speeds_mps: Sequence[float] = SPEEDS_MPS,
    masses: Mapping[str, float] | None = None,
    listed: int = LISTED,
) -> Severity:
    """How severe the contacts among examined rollouts are: those on record, else as they are run again.

    run: what the run is called
    examined: rollouts of its sample need not have been run again where their contacts are on record
    speeds_mps: changes of velocity whose probabilities are wanted
    masses: of vehicles by name (kg), in place of their class's; InputError for one that there is not
    listed: contacts to tell of, the severest first
    """
    events, record = examined.events, examined.events.record
    job, estimate = record.job, record.estimate
    weigh = masses_of(job.scenario, masses)
    own_kg = weigh[job.scenario.vehicles[job.scenario.ego].name]
    hits = _hits(examined, weigh, own_kg)
    sample = examined.sample.tolist()
    delta_v = np.array([hits[i].ego.delta_v_mps if i in hits else -1.0 for i in sample])
    is_hit = delta_v >= 0.0
    again = [i for i in sample if i in examined.reruns]
    (modes,) = modes_by_position([replace(examined, sample=np.array(again, dtype=np.int64))])
    rank = events.ranks(order)
    severest = [i for i in _severest(hits, rank) if i in examined.reruns][:listed]
    return Severity(
        **question_of(run, record),
        method=job.method,
        confidence=estimate.confidence,
        order=order,
        events=len(events),
        examined=examined.sample.size,
        from_record=record.contacts_recorded,
        contact=_likely(examined, is_hit),
        at_least=tuple(_at_least(examined, is_hit & (delta_v >= v), v) for v in speeds_mps),
        injury=_injury(examined, is_hit, [hits[i].ego.injury if i in hits else 0.0 for i in sample]),
        other_injury=_injury(examined, is_hit, [hits[i].struck.injury if i in hits else 0.0 for i in sample]),
        masses_kg=weigh,
        contacts=tuple(_told(examined, i, hits[i], rank[i], modes[i]) for i in severest),
        assumptions=_assumptions(),
        notes=(*notes_on(examined), *_notes(job.scenario.safety.measure, estimate.gamma)),
    )


def examine_severity(
    events: Events,
    rerunner: Rerunner,
    order: Order = "likelihood",
    most: int = LISTED,
    folder: Path | None = None,
    watch: Watch = look_away,
    masses: Mapping[str, float] | None = None,
) -> Examined:
    """What `severity_of` needs, for the same order and masses. Of a record with contacts: all dangerous rollouts, only
    the severest of them run again, for what led up to them; of an older one a sample of `most`, run again."""
    record = events.record
    if not record.contacts_recorded:
        return examine(events, rerunner, most=most, folder=folder, watch=watch)
    weigh = masses_of(record.job.scenario, masses)
    whole = Examined(events, np.arange(len(events)), {})
    hits = _hits(whole, weigh, weigh[record.job.scenario.vehicles[record.job.scenario.ego].name])
    rank = events.ranks(order)
    listed = _severest(hits, rank)[: min(LISTED, most)]
    return replace(whole, reruns=examine(events, rerunner, listed, 0, (), folder, watch).reruns)


def _severest(hits: Mapping[int, _Hit], rank: Mapping[int, int]) -> list[int]:
    """Positions of contacts, the severest first."""
    return sorted(hits, key=lambda i: (-hits[i].ego.injury, rank[i]))


def _hits(examined: Examined, weigh: Mapping[str, float], own_kg: float) -> dict[int, _Hit]:
    """The contacts of the sample, by position."""
    events, record = examined.events, examined.events.record
    found = {}
    for i in examined.sample.tolist():
        key = events.phase, int(events.iterations[i]), int(events.rows[i])
        contact = record.contacts.get(key) if record.contacts_recorded else examined.reruns[i].contact
        if contact is not None:
            found[i] = _hit(events, contact, weigh, own_kg)
    return found


def _hit(events: Events, contact: Contact, weigh: Mapping[str, float], own_kg: float) -> _Hit:
    vehicles = events.record.job.scenario.vehicles
    # background traffic, which has no name: SUMO's default passenger car
    other = vehicles[contact.other].name if contact.other < len(vehicles) else None
    other_kg = class_of(5.0)[1] if other is None else weigh[other]
    return _Hit(contact, other, other_kg, *harms_of(contact, own_kg, other_kg))


def _likely(examined: Examined, member: np.ndarray) -> Likely:
    p, ci = mode_p(examined, member, mode_share(examined, member))
    return Likely(events=int(member.sum()), p=p, ci=ci)


def _at_least(examined: Examined, member: np.ndarray, delta_v_mps: float) -> AtLeast:
    found = _likely(examined, member)
    return AtLeast(events=found.events, p=found.p, ci=found.ci, delta_v_mps=delta_v_mps)


def _injury(examined: Examined, is_hit: np.ndarray, risks: Sequence[float]) -> Injury:
    values = np.array(risks)
    p, ci = mean_p(examined, values)
    weight = examined.events.share[examined.sample][is_hit]
    given, low, high = mean_interval(values[is_hit], weight, examined.events.record.estimate.confidence)
    return Injury(events=int(is_hit.sum()), p=p, ci=ci, given_contact=given, given_contact_ci=(low, high))


def _told(examined: Examined, i: int, hit: _Hit, rank: int, mode: str) -> Severe:
    events = examined.events
    contact = hit.contact
    return Severe(
        rank=rank,
        **events.located(i),
        mode=mode,
        other=hit.other,
        contact=contact,
        direction_deg=math.degrees(math.atan2(contact.left_mps, contact.ahead_mps)),
        other_kg=hit.other_kg,
        ego=hit.ego,
        struck=hit.struck,
    )


def _assumptions() -> tuple[str, ...]:
    classes = ", ".join(f"{name} {mass:,.0f} kg" for name, _, mass in CLASSES)
    return (
        f"A vehicle weighs what is typical of its class, read off its length: {classes}.",
        "Where a front or a rear takes part the impact is plastic: delta-v is the other's share of both masses times "
        "the relative speed at the first touch, wherever on the side it is.",
        "Where side meets side they slide: of the speed across the sides 20% comes back, and along them at most half "
        "of what is exchanged across is lost to friction.",
        "The risk of injury is that of an occupant of a car by delta-v and the area hit (MAIS3+, logistic). It does "
        "not fall to 0 with delta-v: at 0 it is 0.7% to 1.5%, so that among light contacts it says too much.",
        "What follows the first contact (second impacts, leaving the road) is not counted.",
    )


def _notes(measure: str, gamma: float) -> list[str]:
    if measure != IMPACT:
        return [
            f"Only contacts among the rollouts with f <= {gamma:g} are counted, and by the measure {measure!r} there "
            f"may be others: use the measure {IMPACT!r}."
        ]
    if gamma < 0.0:
        return [f"Only contacts at {-gamma:g} m/s or more are counted: use a gamma of 0 or above for all."]
    return []
