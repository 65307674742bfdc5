"""Named conditions that bear on how far an estimate can be relied on (README.md, "Warnings")."""

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from ce.results import Estimate

# Effective events below which an importance-sampling standard error is not to be relied on.
FEW_EVENTS = 30.0
# Pareto k of many events' weights above which the estimate is not to be relied on.
HEAVY_TAIL = 0.7
# Effective events from which a heavy tail alone no longer widens the interval.
ENOUGH_EVENTS = 300.0
# Share of one event's weight in the estimate above which it is said so.
DOMINANT_SHARE = 0.1
# Warnings about the estimate itself: without a target, it has not converged while one of them holds.
ABOUT_THE_ESTIMATE = frozenset(
    {"no-rollouts", "no-events", "few-events", "dominant-weight", "heavy-tailed-weights", "failed-rollouts"}
)


@dataclass(frozen=True)
class EstimateWarning:
    """A named condition that bears on how far the estimate can be relied on.

    name: of the condition, as README.md lists them
    message: what was seen
    remedy: what to do
    """

    name: str
    message: str
    remedy: str


def largest_pareto_k(ess: float) -> float:
    """Pareto k of the weights of events worth `ess` above which the estimate is not to be relied on: 0.5 for 100,
    HEAVY_TAIL from 2,200 on (Vehtari, Simpson, Gelman, Yao and Gabry, JMLR 25, 2024, for a sample of that size)."""
    return min(1.0 - 1.0 / math.log10(ess), HEAVY_TAIL) if ess > 10.0 else 0.0


def warnings_of(est: "Estimate") -> list[EstimateWarning]:
    """Those that the estimation rollouts call for; what the search has to say of itself is not among them."""
    if est.f.size == 0:
        return [
            EstimateWarning(
                "no-rollouts",
                "no estimation rollout has been answered yet; p is not known",
                "go on proposing",
            )
        ]
    return [*_of_events(est), *_of_weights(est), *_of_failures(est), *_of_the_end(est)]


def _of_events(est: "Estimate") -> list[EstimateWarning]:
    if est.events == 0:
        message = (
            f"none of {est.f.size} estimation rollouts had f <= {est.gamma:g}; the interval is an upper bound"
        )
        if est.log_weights is not None:
            message += " that takes the largest weight met for the weight an event would have"
        return [EstimateWarning("no-events", message, "raise the budget or gamma, or search longer")]
    if est.ess >= FEW_EVENTS:
        return []
    return [
        EstimateWarning(
            "few-events",
            f"{est.events} events, worth {est.ess:.1f} of equal weight (fewer than {FEW_EVENTS:g}): "
            "the standard error is itself uncertain",
            "raise the number of estimation rollouts; rely on the interval rather than on p +- std_error",
        )
    ]


def _of_weights(est: "Estimate") -> list[EstimateWarning]:
    found: list[EstimateWarning] = []
    if est.log_weights is not None and est.events > 0 and est.max_weight_share > DOMINANT_SHARE:
        found.append(
            EstimateWarning(
                "dominant-weight",
                f"one event carries {est.max_weight_share:.0%} of the estimate: the proposal misses "
                "part of the event",
                "constrain the search more (mean_box, beta_bounds), give it more samples, or use "
                "naive Monte Carlo",
            )
        )
    limit = largest_pareto_k(est.ess)
    allowed = (
        f"at most {limit:.2f} for {est.ess:.0f} effective events"
        if limit > 0.0
        else (f"{est.ess:.1f} effective events are too few for any tail")
    )
    if est.pareto_k > limit:
        found.append(
            EstimateWarning(
                "heavy-tailed-weights",
                f"Pareto k of the events' weights is {est.pareto_k:.2f} ({allowed}): "
                "events of large weight are probably missing from the sample, so p tends to be too low and std_error "
                "too small",
                "limit the proposal (max_kl, mean_box), give the search more samples, or use naive Monte Carlo",
            )
        )
    return found


def _of_failures(est: "Estimate") -> list[EstimateWarning]:
    if not est.failed:
        return []
    in_estimate = int(np.count_nonzero(np.isnan(est.f)))
    return [
        EstimateWarning(
            "failed-rollouts",
            f"{est.failed} rollouts failed (f was NaN), {in_estimate} of them in the estimate: p counts those as no "
            "events, the upper end of the interval as events",
            "replay them from failed_rollouts and mend the cause",
        )
    ]


def _of_the_end(est: "Estimate") -> list[EstimateWarning]:
    if not est.finished:
        return [EstimateWarning("unfinished", "rollouts are still to come", "go on proposing")]
    if est.rel_error is None or est.converged:
        return []
    return [
        EstimateWarning(
            "precision-not-reached",
            f"relative half-width {est.relative_half_width:.3g}, asked for {est.rel_error:g}",
            "raise the budget",
        )
    ]
