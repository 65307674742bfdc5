"""An acceptance case as its file says it: scenarios with exposures, claims with targets.

format = 1
name = "highway pilot, I-80"
unit = "million km"             # what exposures and rates are per

[[scenario]]
name = "congested"
exposure = 9_600.0              # rollouts of it in a unit of driving
exposure_ci = [9_000.0, 10_200.0]
run = "runs/i80-10s-lidar"      # or counts = { contact = [EVENTS, ROLLOUTS] },
job = "naive"                   # or known = { contact = [P, LOW, HIGH] } (95%)

[[claim]]
name = "contacts"
measure = "contact"             # dangerous, contact, injury, delta-v>=10, unpreventable:r157-cc, preventable:fsm
at_most = 1.0                   # rate per unit

[[claim]]
name = "positive risk balance"
measure = "contact"
human = { rate = 1.15, ci = [1.0, 1.3], source = "..." }   # or events and exposure (in units)
at_most_times = 1.0             # the ego's rate over the human one
"""

import re
import tomllib
from pathlib import Path

import msgspec

from service.errors import InputError

FORMAT = 1
MEASURE = re.compile(r"dangerous|contact|injury|delta-v>=\d+(\.\d+)?|(un)?preventable:\S+")
LARGEST = 1 << 20  # bytes of a case's file


class _Table(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    pass


class Scenario(_Table, frozen=True):
    """A scenario of the case. exposure: rollouts in a unit of driving, exposure_ci: its 95% interval; None: known."""

    name: str
    exposure: float
    exposure_ci: tuple[float, float] | None = None
    run: str = ""
    job: str | None = None
    counts: dict[str, tuple[int, int]] = {}
    known: dict[str, tuple[float, float, float]] = {}


class Human(_Table, frozen=True):
    """A rate of human drivers: with its 95% interval, or as events over an exposure in units."""

    source: str
    rate: float | None = None
    ci: tuple[float, float] | None = None
    events: int | None = None
    exposure: float | None = None


class Claim(_Table, frozen=True):
    """What is to be shown. at_most: rate per unit; at_most_times: of the human rate."""

    name: str
    measure: str
    at_most: float | None = None
    at_most_times: float | None = None
    human: Human | None = None


class Case(_Table, frozen=True):
    """A case. folder: where its file lies, which runs are relative to."""

    format: int
    name: str
    unit: str
    scenario: tuple[Scenario, ...]
    claim: tuple[Claim, ...]
    confidence: float = 0.95
    folder: str = ""


def load_case(path: Path) -> Case:
    """The case in a file; InputError names what is wrong where."""
    try:
        if path.stat().st_size > LARGEST:
            raise InputError(f"{path}: a case of more than {LARGEST} bytes is not read")
        data = tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise InputError(f"cannot read {path}: {error.strerror or error}") from error
    except ValueError as error:
        raise InputError(f"{path} is no TOML: {error}") from error
    try:
        case = msgspec.convert(data, Case)
    except msgspec.ValidationError as error:
        raise InputError(f"{path}: {error}; see service/analysis/acceptance/case.py for the form") from error
    case = msgspec.structs.replace(case, folder=str(path.resolve().parent))
    if (wrong := _wrong(case)) is not None:
        raise InputError(f"{path}: {wrong}")
    return case


def _wrong(case: Case) -> str | None:
    """What is wrong with a case, in words."""
    if case.format != FORMAT:
        return f"format = {case.format}: this version reads {FORMAT}"
    if not case.scenario or not case.claim:
        return "give a [[scenario]] and a [[claim]] at least"
    if not 0.5 <= case.confidence < 1.0:
        return f"confidence = {case.confidence}: give a level from 0.5 to below 1"
    for kind, names in (
        ("scenario", [s.name for s in case.scenario]),
        ("claim", [c.name for c in case.claim]),
    ):
        if len(set(names)) < len(names):
            return f"two {kind}s have the same name"
    for scenario in case.scenario:
        if (wrong := _wrong_scenario(scenario)) is not None:
            return f"scenario {scenario.name!r}: {wrong}"
    for claim in case.claim:
        if (wrong := _wrong_claim(claim)) is not None:
            return f"claim {claim.name!r}: {wrong}"
    return None


def _wrong_scenario(scenario: Scenario) -> str | None:
    if not 0.0 < scenario.exposure < float("inf"):
        return f"exposure = {scenario.exposure}: give rollouts per unit, above 0"
    if scenario.exposure_ci is not None:
        low, high = scenario.exposure_ci
        if not 0.0 < low <= scenario.exposure <= high < float("inf"):
            return f"exposure_ci = {[low, high]}: give ends above 0 with the exposure {scenario.exposure} between them"
    if not (scenario.run or scenario.counts or scenario.known):
        return "give a run, counts or known probabilities"
    for measure, (events, rollouts) in scenario.counts.items():
        if not 0 <= events <= rollouts or rollouts < 1:
            return f"counts of {measure!r} = {[events, rollouts]}: give [events, rollouts]"
    for measure, (p, low, high) in scenario.known.items():
        if not (0.0 <= low <= p <= high <= 1.0 and high > 0.0):
            return f"known {measure!r} = {[p, low, high]}: give [p, low, high] of a probability"
    return None


def _wrong_claim(claim: Claim) -> str | None:
    if not MEASURE.fullmatch(claim.measure):
        return (
            f"measure = {claim.measure!r}: there are dangerous, contact, injury, delta-v>=SPEED, preventable:REFERENCE "
            "and unpreventable:REFERENCE"
        )
    if (claim.at_most is None) == (claim.at_most_times is None):
        return "give at_most or at_most_times, one of them"
    target = claim.at_most if claim.at_most is not None else claim.at_most_times
    if target is None or not 0.0 < target < float("inf"):
        return f"the target {target} must be above 0"
    human = claim.human
    if claim.at_most_times is not None and human is None:
        return "at_most_times needs a human rate to be held against"
    if human is None:
        return None
    if human.rate is not None:
        low, high = human.ci or (0.0, 0.0)
        if not 0.0 < low <= human.rate <= high < float("inf"):
            return f"human ci = {[low, high]}: give the 95% interval of the rate {human.rate}"
    elif human.events is None or human.exposure is None or human.events < 0 or not human.exposure > 0.0:
        return "human: give a rate with its ci, or events and the exposure in units"
    return None
