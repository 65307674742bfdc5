"""What was learned, a sentence each."""

from service.analysis.learned.objects import Rate, Spread
from service.analysis.wording import significant
from service.world.scenario.schema import Scenario

SHIFTS = {  # a start as the search has it against P0: more, less
    "station_m": ("starts {} m further ahead", "starts {} m further back"),
    "lane_offset_m": ("starts {} m further left in its lane", "starts {} m further right in its lane"),
    "heading_deg": ("starts turned {}° more to the left", "starts turned {}° more to the right"),
    "lateral_mps": ("starts {} m/s faster to the left", "starts {} m/s faster to the right"),
    "reaction_s": ("reacts {} s later", "reacts {} s sooner"),
    "glance_onset_s": ("first looks away for long {} s later", "first looks away for long {} s sooner"),
    "glance_duration_s": ("looks away {} s longer", "looks away {} s shorter"),
    "glance_leak": ("looks away in a conflict less often ({})", "looks away in a conflict more often ({})"),
    "acceleration_mode_1": ("presses on: {} in its noise", "holds back: {} in its noise"),
    "acceleration_mode_2": ("slows first, then presses on: {}", "presses on first, then slows: {}"),
    "turn_rate_mode_1": ("steers to the left: {} in its noise", "steers to the right: {} in its noise"),
    "turn_rate_mode_2": ("steers right first, then left: {}", "steers left first, then right: {}"),
}


def shift_sentence(scenario: Scenario, vehicle: str, key: str, base: Spread, proposal: Spread) -> str:
    """How a start has moved."""
    amount = proposal.mean - base.mean
    if not vehicle:
        means = f"{significant(proposal.mean, 2)} instead of {significant(base.mean, 2)}"
        return f"the weather's {key} is {'higher' if amount > 0 else 'lower'}: {means} on average"
    who = named(scenario, vehicle)
    if key == "speed_mps":
        means = f"{significant(proposal.mean)} instead of {significant(base.mean)} m/s"
        share = f"{significant(100.0 * abs(amount) / base.mean, 2)}% " if base.mean > 0.0 else ""
        return f"{who} starts {share}{'faster' if amount > 0 else 'slower'} ({means})"
    more, less = SHIFTS.get(key, (f"has more {key}: {{}}", f"has less {key}: {{}}"))
    return f"{who} {(more if amount > 0 else less).format(significant(abs(amount), 2))}"


def named(scenario: Scenario, vehicle: str) -> str:
    """A vehicle by where it is from the ego's place."""
    ego = scenario.vehicles[scenario.ego]
    if vehicle == ego.name:
        return "the ego"
    (mine,) = (v for v in scenario.vehicles if v.name == vehicle)
    apart = mine.lane - ego.lane  # lane 1 is the leftmost
    if apart == 0:
        return f"{vehicle} in the ego's lane"
    lanes = {1: "one lane", 2: "two lanes"}.get(abs(apart), f"{abs(apart)} lanes")
    return f"{vehicle}, {lanes} {'right' if apart > 0 else 'left'} of the ego,"


def rate_sentence(says: tuple[str, str], unit: str, base: Rate, proposal: Rate) -> str:
    """How a behaviour differs.

    says: the words for more and for less
    """
    assert base.value is not None
    assert proposal.value is not None
    wording = says[0] if proposal.value > base.value else says[1]
    return f"{wording} ({significant(proposal.value)} instead of {significant(base.value)} {unit})"
