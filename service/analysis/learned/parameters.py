"""Each start under P0 and as the search has it, and whether the shift is more than chance."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import stdtrit

import ce
from service.analysis.failures.events import CHAINS, Events
from service.analysis.learned.objects import Parameter, Spread
from service.analysis.learned.spreads import sample_spread, spread_of
from service.analysis.learned.words import shift_sentence
from service.evaluation.record import JobRecord
from service.world.scenario.base import WEATHER
from service.world.scenario.causes import cause_names
from service.world.scenario.schema import Scenario

MOST_DRAWS = 4000  # dangerous rollouts whose starts are looked at: shifts to within 0.02 standard deviations
LEAST_EFFECTIVE = 5.0  # rollouts of equal weight; with fewer no shift is reported
LEAST_SHIFT_SD = 0.1  # a smaller shift matters to nobody, however sure it is
# what a coordinate's key is called beside others, and its unit
KINDS = {
    "station_m": ("position", "m"),
    "lane_offset_m": ("offset", "m"),
    "heading_deg": ("heading", "deg"),
    "lateral_mps": ("lateral speed", "m/s"),
    "reaction_s": ("reaction", "s"),
    "glance_onset_s": ("glance", "s"),
    "glance_duration_s": ("glance", "s"),
    "glance_leak": ("glance", ""),
    "speed_mps": ("speed", "m/s"),
}
# ... and by itself, where that says more
FULL_NAMES = {
    "station_m": "position along the road",
    "lane_offset_m": "offset from the lane's centre",
    "lateral_mps": "speed across the lane",
}
UNITS = {"sun_elevation_deg": "deg", "sun_azimuth_deg": "deg", "visibility_m": "m", "rain_mmph": "mm/h"}


@dataclass(frozen=True)
class Draws:
    """Weighted draws that stand for P0 given the event.

    x: (n, d)
    weight: (n,), summing to one
    ess: effective sample size (Kish), at most that of the estimate
    replication: (n,), of draws that only depend on each other within one
    """

    x: np.ndarray
    weight: np.ndarray
    ess: float
    replication: np.ndarray | None = None


def draws_of(events: Events) -> Draws | None:
    """The starts of a job's dangerous rollouts; None where it has none."""
    n = min(len(events), MOST_DRAWS)
    if n == 0:
        return None
    if events.phase == CHAINS:  # which remember: evenly spread ones rather than the first
        at = np.unique(np.linspace(0, len(events) - 1, n).round().astype(np.int64))
    else:
        at = np.arange(n)
    x = np.array([draw for draw, _ in events.drawn(at.tolist())])
    weight = events.share[at] / events.share[at].sum()
    kish = 1.0 / float(np.sum(weight**2))
    estimate = events.record.estimate
    ess = min(kish, estimate.ess) if isinstance(estimate, ce.ReplicatedEstimate) else kish
    return Draws(x, weight, ess, None if events.replication is None else events.replication[at])


def search_ess(record: JobRecord) -> tuple[int, float]:
    """The iteration whose update gave the proposal that the estimate is drawn from, and the effective number of elites
    that it rests on."""
    final = record.parameters["estimate", record.estimate_iteration]
    for step in reversed(record.training):
        following = record.parameters.get(("train", step.iteration + 1))
        if following is not None and np.array_equal(following, final):
            return step.iteration, step.ess
    last = record.training[-1]
    return last.iteration, last.ess


def parameters_of(
    record: JobRecord,
    proposal: ce.Product | None,
    draws: Draws | None,
    ess: float | None,
    confidence: float,
) -> list[Parameter]:
    """Every start, the weather and the drivers' causes.

    proposal: of which the second column is, else it is of the draws

    The intervals hold together with the confidence asked for (Bonferroni).
    """
    scenario = record.job.scenario
    names = names_of(scenario)
    sure = 1.0 - (1.0 - confidence) / len(names)
    return [
        _parameter(scenario, vehicle, key, column, record.problem.base, proposal, draws, ess, sure)
        for column, (vehicle, key) in enumerate(names)
    ]


def kind_of(vehicle: str, key: str) -> tuple[str, str]:
    """What a coordinate is called beside others, and its unit. vehicle: "" for the weather."""
    return KINDS.get(key, ("noise", "") if vehicle else ("weather", UNITS.get(key, "")))


def names_of(scenario: Scenario) -> Sequence[tuple[str, str]]:
    """(vehicle, key) of the coordinates of X before the driver weights."""
    names = [(vehicle.name, key) for vehicle in scenario.vehicles for key in scenario.start_names]
    names += [] if scenario.weather is None else [("", key) for key in WEATHER]
    for name in cause_names(scenario):
        vehicle, _, key = name.partition(".")
        names.append((vehicle, key))
    return names


def _parameter(
    scenario: Scenario,
    vehicle: str,
    key: str,
    column: int,
    base: ce.Product,
    proposal: ce.Product | None,
    draws: Draws | None,
    ess: float | None,
    sure: float,
) -> Parameter:
    kind, unit = kind_of(vehicle, key)
    before = spread_of(_block(base, column))
    after: Spread | None = None
    half = math.inf
    if proposal is not None and ess is not None:
        after = spread_of(_block(proposal, column))
        half = _half(after.sd / math.sqrt(max(ess - 1.0, 1e-9)), ess, sure)
    elif draws is not None:
        values = draws.x[:, column]
        after = sample_spread(values, draws.weight)
        runs = None if draws.replication is None else np.unique(draws.replication).size
        half = _half(_error(values, after.mean, draws), min(runs or draws.ess, draws.ess), sure)
    shift = ci = None
    if after is not None and before.sd > 0.0:
        amount = after.mean - before.mean
        shift = amount / before.sd
        if math.isfinite(half):
            ci = (amount - half) / before.sd, (amount + half) / before.sd
    significant = (
        shift is not None and ci is not None and abs(shift) >= LEAST_SHIFT_SD and not ci[0] <= 0.0 <= ci[1]
    )
    return Parameter(
        name=f"{vehicle or 'weather'}.{key}",
        vehicle=vehicle,
        kind=kind,  # type: ignore[arg-type]
        unit=unit,
        base=before,
        proposal=after,
        shift_sd=shift,
        shift_sd_ci=ci,
        sentence=shift_sentence(scenario, vehicle, key, before, after)
        if significant and after is not None
        else "",
    )


def _block(product: ce.Product, column: int) -> ce.Beta | ce.Marginal:
    block = product.blocks[product.starts.index(column)]
    assert not isinstance(block, ce.Normal)
    return block


def _error(values: np.ndarray, mean: float, draws: Draws) -> float:
    """Standard error of the weighted mean: over replications where there are any, else from the effective sample
    size."""
    if draws.replication is not None:
        parts = np.bincount(draws.replication, draws.weight * (values - mean))
        runs = np.unique(draws.replication).size
        return math.sqrt(float(parts @ parts) * runs / (runs - 1.0)) if runs > 1 else math.inf
    n = draws.ess
    if n < 2.0:
        return math.inf
    linear = float(np.sum((draws.weight * (values - mean)) ** 2)) * n / (n - 1.0)
    equal = float(draws.weight @ (values - mean) ** 2) / (n - 1.0)
    return math.sqrt(max(linear, equal))


def _half(error: float, ess: float, sure: float) -> float:
    """Half the width of Student's interval; infinite where too few rollouts are behind it."""
    if ess < LEAST_EFFECTIVE:
        return math.inf
    return float(stdtrit(ess - 1.0, 0.5 + 0.5 * sure)) * error
