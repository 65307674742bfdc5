"""What a job came to, as one JSON object, and the comparison of jobs on the same question."""

import math
from collections.abc import Iterable, Sequence
from typing import Any

import msgspec
import numpy as np

import ce
from ce.paths import PathEstimate
from service.evaluation.job import Job
from service.world.scenario.measures import IMPACT, measure_kind

# warnings under which an importance-sampling variance estimate is itself unreliable
SHAKY = {"no-rollouts", "no-events", "few-events", "dominant-weight", "heavy-tailed-weights"}

IMPACT_SPEEDS_MPS = (0.0, 1.0, 2.0, 3.0, 4.0, 5.0)


class ContactKind(msgspec.Struct, frozen=True):
    """One way in which the ego and another vehicle touched: contacts that met with the same sides.

    name: the sides in words
    ego_side, other_side: "front", "rear", "left" or "right"; None where it was not recorded
    rollouts: with such a contact, of those that the estimate is made of, as drawn
    p: probability of such a contact under P0; None where no rollout is there yet
    ci: interval of p, with the estimate's confidence
    """

    name: str
    ego_side: str | None
    other_side: str | None
    rollouts: int
    p: float | None
    ci: tuple[float, float]


class Ending(msgspec.Struct, frozen=True):
    """One way in which rollouts of the estimate ended.

    outcome: "collision", "off-road", "reversing", "finished" (end of the road), "horizon" (time up) or "error"
    rollouts: that ended so, of those that the estimate is made of, as drawn
    p: probability of this ending under P0; None where no rollout is there yet
    ci: interval of p, with the estimate's confidence
    contacts: of a collision, by the sides that met, the likeliest first
    """

    outcome: str
    rollouts: int
    p: float | None
    ci: tuple[float, float]
    contacts: tuple[ContactKind, ...] = ()


class Impact(msgspec.Struct, frozen=True):
    """How probable a contact at a speed or more is, from the same rollouts.

    mps: relative speed at the first touch, at least; 0: any contact
    rollouts: with such a contact, of those that the estimate is made of, as drawn
    p: its probability under P0; None where no rollout is there yet
    ci: interval of p, with the estimate's confidence
    """

    mps: float
    rollouts: int
    p: float | None
    ci: tuple[float, float]


def impacts_of(job: Job, estimate: ce.Estimate) -> tuple[Impact, ...]:
    """p of contacts at IMPACT_SPEEDS_MPS or more, those of the event alone; none where the measure tells no impact
    speeds or there is no estimate."""
    speeds = [v for v in IMPACT_SPEEDS_MPS if -v <= job.gamma]
    if job.scenario.safety.measure != IMPACT or not speeds or not known(estimate):
        return ()
    curve = estimate.curve([0.0 - v for v in speeds])
    return tuple(
        Impact(
            v, int(curve.events[i]), _number(float(curve.p[i])), (float(curve.low[i]), float(curve.high[i]))
        )
        for i, v in enumerate(speeds)
    )


def summary_of(job: Job, estimate: ce.Estimate, cost: "Cost", endings: Sequence[Ending]) -> dict[str, Any]:
    """The object that `tailroad estimate --json` prints."""
    low, high = estimate.ci if known(estimate) else (0.0, 1.0)
    return {
        "p": _number(estimate.p) if known(estimate) else None,
        "std_error": _number(estimate.std_error) if known(estimate) else None,
        "ci": [low, high],
        "confidence": estimate.confidence,
        "gamma": job.gamma,
        "method": job.method,
        "rollouts": {
            "total": estimate.rollouts,
            "training": estimate.training_rollouts,
            "estimation": estimate.estimation_rollouts,
            "failed": estimate.failed,
        },
        "events": estimate.events,
        "ess": estimate.ess,
        "max_weight_share": estimate.max_weight_share,
        "efficiency_vs_naive": _number(estimate.efficiency) if variance_reliable(estimate) else None,
        "variance_reliable": variance_reliable(estimate),
        "converged": estimate.converged,
        "warnings": [{"name": w.name, "message": w.message, "remedy": w.remedy} for w in estimate.warnings],
        "scenario": job.scenario.name,
        "measure": job.scenario.safety.measure,
        "unit": measure_kind(job.scenario.safety.measure).unit,
        "endings": msgspec.to_builtins(endings),
        "impacts": msgspec.to_builtins(impacts_of(job, estimate)),
        "ego": job.ego,
        "seed": job.seed,
        "options": job.options,
        "tailroad": job.tailroad,
        **cost.as_dict(),
    }


def known(estimate: ce.Estimate) -> bool:
    """Whether any rollout that the estimate is made of has an f: where every one failed, p would be nobody's."""
    return not estimate.f.size or not bool(np.isnan(estimate.f).all())


# warnings under which not even the interval can be relied on
NOT_AN_ANSWER = {
    "disputed",
    "job-failed",
    "no-rollouts",
    "threshold-not-reached",
    "dominant-weight",
    "heavy-tailed-weights",
}


def withheld_for(warnings: Iterable[str], training: int) -> tuple[str, ...]:
    """The warnings for which an estimate is withheld: it is told with them, and nothing is made of it.

    training: rollouts of the search; one that has met no event may have looked in the wrong place.
    """
    grave = NOT_AN_ANSWER | ({"no-events"} if training > 0 else set())
    return tuple(name for name in warnings if name in grave)


def variance_reliable(estimate: ce.Estimate) -> bool:
    """Whether the estimate's own variance, and any ratio made of it, can be relied on."""
    return not SHAKY & {w.name for w in estimate.warnings}


class Cost:
    """What a job cost: worker seconds and simulated seconds, how many rollouts SUMO drove (the others were compiled
    calls of the same bits), and the wall clock of this sitting."""

    def __init__(self, workers: int):
        self.workers = workers
        self.wall_s = 0.0
        self.worker_s = 0.0
        self.sim_s = 0.0
        self.in_sumo = 0

    def add(self, worker_s: float, sim_s: float, in_sumo: int) -> None:
        self.worker_s += worker_s
        self.sim_s += sim_s
        self.in_sumo += in_sumo

    def as_dict(self) -> dict[str, float | int | None]:
        return {
            "workers": self.workers,
            "wall_s": round(self.wall_s, 3),
            "worker_s": round(self.worker_s, 3),
            "sim_s": round(self.sim_s, 1),
            "in_sumo": self.in_sumo,
            "x_realtime_per_core": _number(self.sim_s / self.worker_s if self.worker_s else math.nan),
        }


def simulated(estimate: ce.Estimate) -> tuple[float, float]:
    """What an estimate has cost in rollouts, and its part without the search; of paths, which share what they have in
    common, simulated steps over those of a whole rollout."""
    if not isinstance(estimate, PathEstimate) or not estimate.cost.path_steps > 0.0:
        return float(estimate.rollouts), float(estimate.estimation_rollouts)
    cost = estimate.cost
    return cost.steps / cost.path_steps, (cost.steps - cost.training_steps) / cost.path_steps


def comparison_of(naive: ce.Estimate, other: ce.Estimate) -> dict[str, Any]:
    """How `other` compares with naive Monte Carlo on the same question.

    ratio_of_rare_events: events a rollout under the proposal over events a rollout under P0. ratio_of_variances: of
    naive Monte Carlo with as many estimation rollouts over that of `other` (training left out, as the paper's Figure
    2 does). efficiency: the same with training counted. Of paths, rollouts are simulated steps in whole rollouts. Both
    variances of naive Monte Carlo are p (1 - p) / n with p from the estimate that knows it better. difference_z: the
    two estimates' difference in standard errors.
    """
    rate = naive.events / naive.estimation_rollouts if naive.estimation_rollouts else math.nan
    other_rate = other.events / other.estimation_rollouts if other.estimation_rollouts else math.nan
    better = min((naive, other), key=lambda e: e.relative_half_width)
    spread = math.hypot(naive.std_error, other.std_error)
    variance = other.std_error**2 if other.std_error > 0.0 else math.nan
    bernoulli = better.p * (1.0 - better.p)
    spent, estimation = simulated(other)
    return {
        "ratio_of_rare_events": _number(other_rate / rate if rate else math.nan),
        "ratio_of_variances": _number(bernoulli / max(estimation, 1.0) / variance),
        "efficiency": _number(bernoulli / max(spent, 1.0) / variance),
        "variance_reliable": variance_reliable(other),
        "difference_z": _number((other.p - naive.p) / spread if spread else math.nan),
    }


def comparisons(jobs: Sequence[Job], estimates: dict[str, ce.Estimate]) -> list[dict[str, Any]]:
    """Every job of a run against the naive one of its threshold and seed, where there is one."""
    naive = {(job.gamma, job.seed): estimates[job.id] for job in jobs if job.method == "naive"}
    return [
        {"method": job.id} | comparison_of(naive[job.gamma, job.seed], estimates[job.id])
        for job in jobs
        if job.method != "naive" and (job.gamma, job.seed) in naive
    ]


def _number(value: float) -> float | None:
    """JSON has no NaN and no infinity."""
    return value if math.isfinite(value) else None


def json_ready(value: Any) -> Any:
    """The same with None for numbers that JSON has no word for."""
    if isinstance(value, dict):
        return {str(k): json_ready(v) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [json_ready(v) for v in value]
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
