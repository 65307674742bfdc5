"""What a scenario's run says of a measure, as a quantity with both its confidence distributions."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import ce
from service.analysis.acceptance.case import Scenario
from service.analysis.acceptance.quantity import Quantity, counted, tabled, told
from service.analysis.prevention.objects import Prevention
from service.analysis.severity.objects import Severity
from service.errors import InputError
from service.evaluation.endings import estimate_of, outcomes_of
from service.evaluation.pool import OUTCOME_CODES
from service.evaluation.record import JobRecord
from service.evaluation.store import RunDirectory
from service.evaluation.summary import withheld_for

OF_FILES = 0.95  # confidence of intervals that a case's file gives
Severities = Callable[[Path, str | None, float], Severity]  # of a run's job; the delta-v that is asked for
Preventions = Callable[[Path, str | None, str], Prevention]  # by a reference driver


def quantity_of(
    scenario: Scenario,
    measure: str,
    folder: Path,
    record: JobRecord | None,
    severities: Severities,
    preventions: Preventions,
) -> tuple[Quantity, tuple[str, ...]]:
    """The probability of a measure per rollout of a scenario, and why it cannot be relied on, where that is so.

    folder: that the scenario's run is relative to; record: of its job, None without a run. InputError where the
    scenario says nothing of the measure.
    """
    if measure in scenario.counts:
        return counted(*scenario.counts[measure]), ()
    if measure in scenario.known:
        return told(*scenario.known[measure], OF_FILES), ()
    if record is None:
        raise InputError(
            f"scenario {scenario.name!r} says nothing of {measure!r}: give a run, counts or known"
        )
    estimate = record.estimate
    if not estimate.estimation_rollouts:
        raise InputError(f"scenario {scenario.name!r}: {scenario.run} has no estimate yet")
    withheld = withheld_for((w.name for w in estimate.warnings), estimate.training_rollouts)
    run = folder / scenario.run
    if measure == "dangerous":
        return of_estimate(estimate), withheld
    if measure == "contact":
        with RunDirectory.open(run) as store:
            codes = outcomes_of(estimate, list(store.all_chunks(record.job.id)))
        return of_estimate(estimate_of(estimate, codes, OUTCOME_CODES["collision"])), withheld
    kind, _, reference = measure.partition(":")
    if reference:
        found = preventions(run, scenario.job, reference)
        by = next(one for one in found.references if one.reference == reference)
        part = by.preventable if kind == "preventable" else by.unpreventable
        return _told(part.p, part.ci, found.confidence, estimate.f.size), withheld
    speed = float(measure.partition(">=")[2] or 0.0)
    severe = severities(run, scenario.job, speed)
    likely = severe.injury if measure == "injury" else severe.at_least[0]
    return _told(likely.p, likely.ci, severe.confidence, estimate.f.size), withheld


def _told(p: float, ci: tuple[float, float], confidence: float, samples: int) -> Quantity:
    return replace(told(p, *ci, confidence), samples=samples)


def of_estimate(estimate: ce.Estimate) -> Quantity:
    """The probability that an estimate is of."""
    plain = not isinstance(estimate, ce.ReplicatedEstimate) and estimate.log_weights is None
    if plain and estimate.spending == estimate.sampling_share == 1.0:
        failed = int((estimate.f != estimate.f).sum())
        return counted(estimate.events, estimate.f.size, failed)
    return tabled(estimate.p, lambda c: replace(estimate, confidence=c).ci, estimate.f.size)
