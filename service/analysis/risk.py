"""Risk in words: p of a scenario as a rate per million kilometres, beside a baseline, always with its interval.

The rate is p over the kilometres that the ego drives in a rollout. Whether it means anything for a road is a matter of
the assumptions, which go with it wherever it is shown.
"""

import math
from collections.abc import Sequence

import msgspec

import ce
from service.analysis.exposure import Exposure
from service.analysis.wording import level, significant
from service.errors import InputError
from service.evaluation.job import Job
from service.evaluation.summary import withheld_for
from service.world.scenario.measures import IMPACT, measure_kind

MILLION = 1e6
KM_PER_MILE = 1.609344


class Baseline(msgspec.Struct, frozen=True, kw_only=True):
    """What a risk is held against."""

    name: str
    per_million_km: float
    source: str


# An ego's rate is per vehicle, so what it is held against counts vehicles: a crash of two vehicles is two of them.
CITIES = "of the places and roads of Kusano et al. 2024 (arXiv 2312.12675, Waymo's benchmark)"
POLICE_REPORTED = Baseline(
    name="human-driven vehicles in police-reported crashes",
    per_million_km=4.68 / KM_PER_MILE,
    source=f"4.68 crashed vehicles per million vehicle miles, {CITIES}",
)
ANY_INJURY = Baseline(
    name="human-driven vehicles in crashes with any injury reported",
    per_million_km=2.80 / KM_PER_MILE,
    source=f"2.80 crashed vehicles per million vehicle miles, {CITIES}",
)
ANY_CRASH = Baseline(
    name="human-driven vehicles in crashes of any kind in the SHRP 2 study",
    per_million_km=1549 / (34e6 * KM_PER_MILE) * MILLION,
    source="SHRP 2 naturalistic driving study: 1,549 crashes of its vehicles, kerb strikes included (Hankey et al. "
    "2016), in over 34 million vehicle miles (Blanco et al. 2016)",
)
NEAR_CRASHES = Baseline(
    name="near-crashes of human drivers in the 100-Car study",
    per_million_km=760 / (2.0e6 * KM_PER_MILE) * MILLION,
    source="100-Car study (NHTSA, DOT HS 810 593): 760 near-crashes of its vehicles in its public event database "
    "(secondary sources also give 761) in about 2 million vehicle miles; taken from secondary sources, not from the "
    "report itself",
)
BASELINES = {
    "police-reported": POLICE_REPORTED,
    "any-injury": ANY_INJURY,
    "any-crash": ANY_CRASH,
    "near-crash": NEAR_CRASHES,
}


class Risk(msgspec.Struct, frozen=True, kw_only=True):
    """p of a rollout, and the rate that it comes to."""

    p: float | None
    ci: tuple[float, float]
    confidence: float
    exposure: Exposure
    per_million_km: float | None
    per_million_km_ci: tuple[float, float | None]  # holds the uncertainty of p and of the kilometres
    km_between: float | None  # kilometres from one event to the next
    km_between_ci: tuple[float, float | None]  # None here and above: no upper end
    baseline: Baseline
    times_baseline: float | None
    times_baseline_ci: tuple[float, float | None]
    summary: str = ""
    said: str  # summary by its old name
    assumptions: tuple[str, ...]


def baseline_of(given: str | None, source: str | None = None) -> Baseline:
    """The baseline that the user names, or gives as events per million km; POLICE_REPORTED where nothing is given."""
    if given is None:
        return POLICE_REPORTED
    if given in BASELINES:
        return BASELINES[given]
    try:
        rate = float(given)
    except ValueError:
        rate = math.nan
    if not 0.0 < rate < math.inf:
        raise InputError(
            f"--baseline {given}: give events per million km (a number above 0), or one of {', '.join(BASELINES)}"
        )
    return Baseline(name="the baseline given", per_million_km=rate, source=source or "given by the user")


def risk_of(
    job: Job, estimate: ce.Estimate, exposure: Exposure, baseline: Baseline = POLICE_REPORTED
) -> Risk:
    """The risk that a job's estimate stands for."""
    p = estimate.p if estimate.estimation_rollouts else None
    event = event_of(msgspec.structs.replace(job, gamma=estimate.gamma))
    withheld = withheld_for((w.name for w in estimate.warnings), estimate.training_rollouts)
    return rate_of(p, estimate.ci, estimate.confidence, exposure, event, baseline, withheld)


def rate_of(
    p: float | None,
    ci: tuple[float, float],
    confidence: float,
    exposure: Exposure,
    event: str,
    baseline: Baseline = POLICE_REPORTED,
    withheld: Sequence[str] = (),
) -> Risk:
    """The risk of an event of probability p per rollout.

    event: in words, as in "a time to collision of at most 0.5 s"
    withheld: warnings for which the estimate cannot be relied on, and no rate is made of it

    The interval takes p's interval at the kilometres' other end, so it is a little wider than it need be.
    """
    low, high = ci
    short, long = exposure.km_ci
    rate = None if p is None or exposure.km <= 0.0 else p / exposure.km * MILLION
    least = low / long * MILLION if long > 0.0 else 0.0
    most = high / short * MILLION if short > 0.0 else None
    per = baseline.per_million_km
    rate_ci = least, most
    between_ci = MILLION / most if most else 0.0, MILLION / least if least > 0.0 else None
    times_ci = least / per, None if most is None else most / per
    if withheld:
        rate, rate_ci, between_ci, times_ci = None, (0.0, None), (0.0, None), (0.0, None)
        summary = _no_rate(event, withheld)
    else:
        summary = _summary(event, p, rate, rate_ci, between_ci, confidence, times_ci, baseline)
    return Risk(
        p=p,
        ci=ci,
        confidence=confidence,
        exposure=exposure,
        per_million_km=rate,
        per_million_km_ci=rate_ci,
        km_between=MILLION / rate if rate else None,
        km_between_ci=between_ci,
        baseline=baseline,
        times_baseline=None if rate is None else rate / per,
        times_baseline_ci=times_ci,
        summary=summary,
        said=summary,
        assumptions=_assumptions(exposure, event, baseline),
    )


def _no_rate(event: str, withheld: Sequence[str]) -> str:
    return (
        f"{event[:1].upper()}{event[1:]}: no rate per million km, because the estimate cannot be relied on "
        f"({', '.join(withheld)}); see its warnings and their remedies."
    )


def _summary(
    event: str,
    p: float | None,
    rate: float | None,
    rate_ci: tuple[float, float | None],
    between_ci: tuple[float, float | None],
    confidence: float,
    times_ci: tuple[float, float | None],
    baseline: Baseline,
) -> str:
    """The risk in two sentences, each with its interval."""

    def say(value: float | None) -> str:
        return "∞" if value is None else significant(value, 2)

    sure = level(confidence)
    (low, high), (least, most) = rate_ci, times_ci
    what = event[:1].upper() + event[1:]
    against = f"the {baseline.name} ({significant(baseline.per_million_km)} per million km)"
    if not p or rate is None:
        return (
            f"{what}: at most {say(high)} times per million km ({sure} interval from 0), or at least "
            f"{say(between_ci[0])} km from one to the next. At most {say(most)} times {against}."
        )
    return (
        f"{what}: about {say(rate)} times per million km ({sure} interval {say(low)} to {say(high)}), or once in "
        f"{say(MILLION / rate)} km ({say(between_ci[0])} to {say(between_ci[1])}). "
        f"That is {say(least)} to {say(most)} times {against}."
    )


def event_of(job: Job) -> str:
    """The event of a job in words."""
    kind = measure_kind(job.scenario.safety.measure)
    if job.scenario.safety.measure == IMPACT:
        if job.gamma > 0.0:
            return f"a time until the boxes touch of at most {job.gamma:g} s, or a contact"
        return "a contact" if job.gamma == 0.0 else f"a contact at {-job.gamma:g} m/s or more"
    words = kind.words.rstrip(",").removeprefix("smallest ")
    article = "an" if words[0] in "aeiou" or words.startswith("RSS") else "a"
    return f"{article} {words} of at most {job.gamma:g} {kind.unit}".rstrip()


def _assumptions(exposure: Exposure, event: str, baseline: Baseline) -> tuple[str, ...]:
    short, long = exposure.km_ci
    return (
        f"All driving is like this scenario: every kilometre is driven in rollouts of {significant(exposure.km)} km "
        f"({significant(short)} to {significant(long)} km, from {exposure.rollouts} rollouts of P0) that start as P0 "
        "says.",
        f"The event is {event}, with whatever damage or none: there are more of them than crashes that anybody reports."
        if event.startswith("a contact")
        else f"The event is {event}, which is not a crash: most are followed by none, so the rate is no crash rate, "
        "and a multiple of a rate of crashes says how much more frequent the event is, not how dangerous the ego is.",
        "A rollout counts once, however often the event comes in it.",
        "Traffic is as P0 has it: its starts and drivers are models fitted to recordings of one road.",
        f"The baseline is from other driving ({baseline.source}), over all roads, hours and weathers of its data.",
    )
