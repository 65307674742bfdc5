"""From a case to its verdicts: lambda = sum of exposure times probability, with a joint interval."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from service.analysis.acceptance.case import Case, Claim, Human, Scenario
from service.analysis.acceptance.combine import Combined, ratio, sum_of_products
from service.analysis.acceptance.measured import OF_FILES
from service.analysis.acceptance.objects import Acceptance, Judged, Needed, Term, Verdict
from service.analysis.acceptance.quantity import Quantity, exactly, happened, sharper, told
from service.analysis.wording import significant

Probability = Callable[[Scenario, str], tuple[Quantity, tuple[str, ...]]]
MOST_TIMES = 1e6  # more rollouts than this many times those that there are, nobody runs


@dataclass(frozen=True)
class _Part:
    scenario: Scenario
    exposure: Quantity
    p: Quantity
    withheld: tuple[str, ...]


def accept(case: Case, probability: Probability) -> Acceptance:
    """The verdicts of a case.

    probability: of a measure per rollout of a scenario, and why it cannot be relied on

    A claim is met where the one-sided upper bound at the case's confidence is at most the target, not met where the
    lower bound is above it, undecided between, and wherever an estimate cannot be relied on.
    """
    claims = tuple(_judge(case, claim, probability) for claim in case.claim)
    verdicts = {claim.verdict for claim in claims}
    whole: Verdict = "not met" if "not met" in verdicts else "undecided" if "undecided" in verdicts else "met"
    return Acceptance(
        name=case.name, unit=case.unit, confidence=case.confidence, verdict=whole, claims=claims
    )


def _judge(case: Case, claim: Claim, probability: Probability) -> Judged:
    parts = [_Part(s, _exposure(s), *probability(s, claim.measure)) for s in case.scenario]
    human = None if claim.human is None or claim.at_most_times is None else _human(claim.human)
    target = claim.at_most if claim.at_most is not None else claim.at_most_times
    assert target is not None  # `load_case` has seen to it
    found = _combined(parts, human)
    lower, upper = found.lower(case.confidence), found.upper(case.confidence)
    withheld = sorted({name for part in parts for name in part.withheld})
    verdict = _verdict(lower, upper, target, bool(withheld))
    low, high = found.interval(case.confidence)
    return Judged(
        claim=claim.name,
        measure=claim.measure,
        of_human=human is not None,
        value=_finite(found.value),
        ci=(low, _finite(high)),
        lower=lower,
        upper=_finite(upper),
        target=target,
        verdict=verdict,
        why=_why(verdict, lower, upper, target, case.confidence, withheld),
        terms=tuple(_term(part, case.confidence) for part in parts),
        human="" if human is None or claim.human is None else _human_says(claim.human, human, case),
        needed=_needed(parts, human, target, case.confidence, found) if verdict == "undecided" else None,
    )


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None


def _exposure(scenario: Scenario) -> Quantity:
    if scenario.exposure_ci is None:
        return exactly(scenario.exposure)
    return told(scenario.exposure, *scenario.exposure_ci, OF_FILES)


def _human(human: Human) -> Quantity:
    if human.rate is not None and human.ci is not None:
        return told(human.rate, *human.ci, OF_FILES)
    assert human.events is not None  # `load_case` has seen to it
    assert human.exposure is not None
    return happened(human.events, human.exposure)


def _human_says(human: Human, rate: Quantity, case: Case) -> str:
    low, high = rate.interval(case.confidence)
    return f"{significant(rate.value)} per {case.unit} ({significant(low)} to {significant(high)}): {human.source}"


def _combined(parts: Sequence[_Part], human: Quantity | None) -> Combined:
    total = sum_of_products([(part.exposure, part.p) for part in parts])
    return total if human is None else ratio(total, human)


def _verdict(lower: float, upper: float, target: float, withheld: bool) -> Verdict:
    if withheld:
        return "undecided"
    if upper <= target:
        return "met"
    return "not met" if lower > target else "undecided"


def _why(
    verdict: Verdict, lower: float, upper: float, target: float, confidence: float, withheld: Sequence[str]
) -> str:
    sure = f"at {confidence:.0%} confidence"
    if withheld:
        return f"an estimate cannot be relied on ({', '.join(withheld)}): see its warnings and their remedies"
    if verdict == "met":
        return f"{sure} it is at most {significant(upper)}, and {significant(target)} is allowed"
    if verdict == "not met":
        return f"{sure} it is at least {significant(lower)}, and {significant(target)} is allowed"
    most = significant(upper) if math.isfinite(upper) else "anything"
    return f"{sure} it is between {significant(lower)} and {most}, and {significant(target)} lies between"


def _term(part: _Part, confidence: float) -> Term:
    return Term(
        scenario=part.scenario.name,
        p=part.p.value,
        ci=part.p.interval(confidence),
        exposure=part.exposure.value,
        exposure_ci=part.exposure.interval(confidence),
        rate=part.exposure.value * part.p.value,
        rollouts=part.p.samples or None,
        withheld=part.withheld,
    )


def _needed(
    parts: Sequence[_Part], human: Quantity | None, target: float, confidence: float, found: Combined
) -> Needed:
    """Rollouts of the scenario alone that, the cheapest, would decide; else of all scenarios in proportion."""
    met = found.value <= target
    counted = [i for i, part in enumerate(parts) if part.p.samples]
    choices = [([i], times) for i in counted if (times := _times(parts, [i], human, target, confidence, met))]
    if not choices and len(counted) > 1 and (times := _times(parts, counted, human, target, confidence, met)):
        choices = [(counted, times)]
    if not choices:
        return Needed(
            more={},
            says="no number of rollouts decides it: what is uncertain of the exposures, of the human rate or of known "
            "probabilities does not, or the value is too close to the target",
        )
    which, times = min(choices, key=lambda one: sum(parts[i].p.samples * (one[1] - 1.0) for i in one[0]))
    more = {parts[i].scenario.name: math.ceil(parts[i].p.samples * times) for i in which}
    rollouts = " and ".join(f"{n:,} rollouts of {name}" for name, n in more.items())
    return Needed(
        more=more, says=f"{'met' if met else 'not met'} with {rollouts} in all, if they say the same"
    )


def _times(
    parts: Sequence[_Part],
    which: Sequence[int],
    human: Quantity | None,
    target: float,
    confidence: float,
    met: bool,
) -> float | None:
    """How many times the rollouts of these scenarios would decide; None where none of up to MOST_TIMES does."""

    def decides(times: float) -> bool:
        then = [
            _Part(part.scenario, part.exposure, sharper(part.p, times) if i in which else part.p, ())
            for i, part in enumerate(parts)
        ]
        found = _combined(then, human)
        return found.upper(confidence) <= target if met else found.lower(confidence) > target

    low, high = 0.0, math.log(MOST_TIMES)
    if not decides(MOST_TIMES):
        return None
    for _ in range(12):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if decides(math.exp(middle)) else (middle, high)
    return math.exp(high)
