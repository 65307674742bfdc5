"""Carries out a plan on a fleet: jobs are known by their label, so that the same command finds them again, anywhere.

A fleet runs everything in SUMO. It answers estimates and curves, not single rollouts: the error of an estimate's own
variance is not known then, and ratios of variances of single runs have no interval; those of repeated runs do.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ce.interval import clopper_pearson
from service.errors import InputError
from service.remote.api import objects as O
from service.remote.client import Client
from service.studies.reproduce.local import Outcome, Watch
from service.studies.reproduce.plans import Plan, Run, Truth, curve_gammas, fine_gammas
from service.studies.reproduce.results import Reading, Result
from service.studies.reproduce.truth import CONFIDENCE, truth_job
from service.world.scenario import load_scenario
from service.world.scenario.fixed import toml_of
from service.world.scenario.noise_mode import NoiseMode, with_noise_mode

COMMON = ("budget", "rel_error", "confidence")
LOST = ("failed", "cancelled")  # such a job is submitted anew
REPLICATED = "splitting"
REPLICATIONS = 10  # of splitting, by default: what its variance rests on


@dataclass(frozen=True)
class FleetTruth:
    """A ground truth of which p is known at some thresholds."""

    rollouts: int
    worker_s: float
    points: dict[float, int]  # threshold -> events

    def at(self, gammas: Any) -> dict[str, np.ndarray]:
        """As `GroundTruth.at`; InputError for a threshold that was not asked for."""
        asked = np.atleast_1d(np.asarray(gammas, dtype=np.float64))
        missing = [float(g) for g in asked if float(g) not in self.points]
        if missing:
            raise InputError(f"the fleet was not asked for p at {missing[0]:g} s")
        events = np.array([self.points[float(g)] for g in asked])
        low, high = clopper_pearson(events, self.rollouts, CONFIDENCE)
        p = events / max(self.rollouts, 1)
        return {"p": p, "low": low, "high": high, "events": events,
                "std_error": np.sqrt(p * (1.0 - p) / max(self.rollouts, 1))}  # fmt: skip


def carry_out_on(client: Client, plan: Plan, watch: Watch) -> Outcome:
    """Submit what is not there yet, wait for all of it, and read it. InputError where a job fails."""
    known = {job.label: job for job in client.all_jobs() if job.status not in LOST}
    drivers = truth_job(plan.truth).weights_sha256[:8]  # other drivers make other rollouts
    truly = plan.truth
    naive = _submitted(client, known, f"{_truth_label(truly)} {drivers}", truly.scenario, None, 0.5, truly.ego,
                       "naive", truly.seed, {"budget": truly.rollouts})  # fmt: skip
    jobs = [
        _submitted(client, known, f"reproduce {run.folder} {drivers}", run.scenario, run.noise_mode, run.gamma, run.ego,
                   run.method, run.seed, run.options)
        for run in plan.runs
    ]  # fmt: skip
    watch.on_part(f"ground truth, {plan.truth.ego} in {plan.truth.scenario}", plan.truth.rollouts)
    _wait(client, naive, plan.truth.rollouts, watch)
    truth = _truth(client, naive, plan)
    results = []
    for run, job in zip(plan.runs, jobs, strict=True):
        watch.on_part(f"{run.series}, seed {run.seed}", run.budget)
        _wait(client, job, run.budget, watch)
        results.append(_result(client, job, run, plan.gammas))
    return Outcome(plan, truth, tuple(results), True)


def _truth_label(truth: Truth) -> str:
    return f"reproduce truth {truth.scenario}-{truth.ego}-{truth.seed}-{truth.rollouts}"


def _submitted(
    client: Client,
    known: dict[str, O.Job],
    label: str,
    scenario: str,
    noise_mode: NoiseMode | None,
    gamma: float,
    ego: str,
    method: str,
    seed: int,
    options: dict[str, Any],
) -> str:
    """The id of the job with that label, submitted where there is none."""
    if label not in known:
        rest = {key: value for key, value in options.items() if key not in COMMON}
        common = {key: options[key] for key in COMMON if key in options}
        known[label] = client.submit(_as_sent(scenario, noise_mode), gamma, ego=ego, method=method, seed=seed,
                                     label=label, options=rest, **common)  # fmt: skip
    return known[label].id


def _as_sent(scenario: str, noise_mode: NoiseMode | None) -> str | dict[str, Any]:
    """A scenario by its name, or by value where its noise mode is another."""
    if noise_mode is None:
        return scenario
    import tomllib

    return tomllib.loads(toml_of(with_noise_mode(load_scenario(scenario), noise_mode)))


def _wait(client: Client, job: str, most: int, watch: Watch) -> None:
    """Until the job is over, telling of its rollouts."""
    reported = 0
    for count in _progress(client, job):
        watch.on_rollouts(max(count - reported, 0))
        reported = max(reported, count)
    found = client.job(job)
    if found.status != "done":
        raise InputError(
            f"job {job} of the fleet is {found.status}: {found.reason or 'no reason given'}; the same command "
            "submits it anew"
        )
    watch.on_rollouts(max(most - reported, 0))


def _progress(client: Client, job: str) -> Iterator[int]:
    for event in client.watch(job):
        if event.kind == "progress":
            yield int(event.body["rollouts"])


def _truth(client: Client, job: str, plan: Plan) -> FleetTruth:
    fine = () if plan.runs else fine_gammas()  # a ground truth alone is read for its quantiles
    gammas = sorted({*plan.gammas, *curve_gammas(plan), *fine})
    found = client.estimate(job)
    curve = client.curve(job, gammas)
    return FleetTruth(
        found.rollouts.total, found.worker_s, {g: p.events for g, p in zip(gammas, curve.points, strict=True)}
    )


def _result(client: Client, job: str, run: Run, gammas: Sequence[float]) -> Result:
    found = client.estimate(job)
    replicated = math.sqrt(2.0 / (REPLICATIONS - 1)) if found.method == REPLICATED else None
    readings = tuple(
        Reading(gamma=point.gamma, p=point.p, std_error=point.std_error, low=point.ci[0], high=point.ci[1],
                events=point.events, ess=point.ess, variance_error=replicated)
        for point in client.curve(job, gammas).points
    )  # fmt: skip
    return Result(
        run=run,
        method=found.method,
        rollouts=found.rollouts.total,
        training=found.rollouts.training,
        readings=readings,
        warnings=tuple(w.name for w in found.warnings),
        reliable=found.variance_reliable,
        max_weight_share=found.max_weight_share or 0.0,
        worker_s=found.worker_s,
        sim_s=found.sim_s,
        wall_s=found.wall_s,
        tailroad=found.tailroad,
    )
