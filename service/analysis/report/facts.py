"""Everything that the report says, as one JSON-ready dictionary: report.json, and what the page is made from."""

import math
import platform
from collections.abc import Sequence
from dataclasses import asdict
from datetime import datetime
from importlib.metadata import PackageNotFoundError, version
from typing import Any

import msgspec
import numpy as np

import ce
from service.analysis.exposure import Exposure
from service.analysis.failures.examine import mode_name
from service.analysis.failures.objects import Failures
from service.analysis.failures.rerun import Rerunner
from service.analysis.learned.learn import learned_of
from service.analysis.learned.objects import Learned
from service.analysis.report import words
from service.analysis.report.dangerous import Findings, ShownRollout
from service.analysis.report.objects import FORMAT, Report
from service.analysis.risk import POLICE_REPORTED, Baseline, event_of, rate_of
from service.analysis.thresholds import curve_gammas
from service.evaluation.job import Job
from service.evaluation.record import FailedRollout, JobRecord
from service.evaluation.summary import Cost, comparisons, json_ready, summary_of, variance_reliable
from service.world.scenario.measures import measure_kind
from service.world.scenario.renamed import to_written

FAILURES_LISTED = 20
PACKAGES = ("tailroad", "libsumo", "numpy", "scipy", "numba", "cvxpy")
XI_OUTPUTS = ("mean acceleration", "mean turn rate", "log spread of acceleration", "log spread of turn rate")


def facts_of(
    run: str,
    records: Sequence[JobRecord],
    seen: Findings,
    now: datetime,
    baseline: Baseline = POLICE_REPORTED,
    served: bool = False,
) -> dict[str, Any]:
    """The report's facts. Numbers that are not finite are None. served: the run is a job of a service."""
    known = [r for r in records if r.estimate.estimation_rollouts]
    compared = comparisons([r.job for r in known], {r.job.id: r.estimate for r in known})
    against_naive = {c["method"]: c for c in compared}
    gammas = curve_gammas(records)
    jobs = [_job(r, against_naive.get(r.job.id), gammas) for r in records]
    first = records[0].job
    kind = measure_kind(first.scenario.safety.measure)
    learned = {r.job.id: seen.learned.get(r.job.id) or starts_learned(r) for r in records}
    headline = _headline(jobs)
    facts = {
        "format": FORMAT,
        "made": now.isoformat(timespec="seconds"),
        "run": run,
        "served": served,
        "question": words.question(first),
        "headline": headline,
        "disagreement": _disagreement(jobs),
        "scenario": {
            "name": first.scenario.name,
            "description": first.scenario.description,
            "built_in": words.is_built_in(first),
            "road": words.road_name(first),
            "ego": first.ego,
            "gamma": first.gamma,
            "measure": first.scenario.safety.measure,
            "measure_words": kind.words.rstrip(","),
            "unit": kind.unit,
            "horizon_s": first.scenario.time.horizon_s,
            "step_s": first.scenario.time.step_s,
            "vehicles": len(first.scenario.vehicles),
            "drivers": first.scenario.drivers.weights,
            "noise_mode": first.scenario.drivers.noise_mode,
            "noise": first.scenario.drivers.noise_mode,
            "dimension": records[0].problem.base.dim,
            "drivers_sha256": first.weights_sha256,
            "file": to_written(msgspec.to_builtins(first.scenario)),
        },
        "jobs": jobs,
        "risk": _risk(headline, first, seen.exposure, baseline),
        "learned": {job: msgspec.to_builtins(found) for job, found in learned.items()},
        "failure_modes": _failure_modes(seen.failures),
        "dangerous": [_dangerous(r) for r in seen.rollouts],
        "commands": words.commands([r.job for r in records]),
        "versions": _versions(first.tailroad),
    }
    facts = json_ready(facts)
    msgspec.convert(facts, Report)  # what is written is what the published schema says
    return facts


def _risk(
    headline: dict[str, Any], job: Job, exposure: Exposure | None, baseline: Baseline
) -> dict[str, Any] | None:
    """The headline's p as a rate; None where the kilometres are not known."""
    if exposure is None:
        return None
    found = rate_of(
        headline["p"], tuple(headline["ci"]), headline["confidence"], exposure, event_of(job), baseline
    )
    return msgspec.to_builtins(found)


def _job(record: JobRecord, against_naive: dict[str, Any] | None, gammas: np.ndarray) -> dict[str, Any]:
    job, estimate = record.job, record.estimate
    cost = Cost(workers=0)
    cost.add(record.worker_s, record.sim_s)
    summary = summary_of(job, estimate, cost)
    del summary["workers"], summary["wall_s"]  # of a sitting, which the record does not know
    trace, curve = estimate.trace(), estimate.curve(gammas)
    headline, interval = words.answer(summary)
    return summary | {
        "id": job.id,
        "method_name": words.METHOD_NAMES.get(job.method, job.method),
        "method_used": estimate.method,
        "by_method": words.BY_METHOD.get(job.method, job.method),
        "answer": headline,
        "answer_interval": interval,
        "finished": estimate.finished,
        "progress": {
            "planned": record.planned,
            "recorded": record.recorded,
            "counted": estimate.rollouts,
        },
        "options_without_flag": words.options_without_flag(job),
        "stream_seed": str(record.problem.stream_seed),  # 64 bits: too many for a JSON number
        "pareto_k": estimate.pareto_k,
        "against_naive": against_naive,
        "variance_reliable": variance_reliable(estimate),
        "trace": {
            "rollouts": (trace.rollouts + estimate.training_rollouts).tolist(),
            "p": trace.p.tolist(),
            "low": trace.low.tolist(),
            "high": trace.high.tolist(),
        },
        "curve": {
            "gamma": curve.gammas.tolist(),
            "p": curve.p.tolist(),
            "low": curve.low.tolist(),
            "high": curve.high.tolist(),
            "events": curve.events.tolist(),
        },
        "training": [msgspec.to_builtins(r) for r in record.training],
        "estimation": [msgspec.to_builtins(r) for r in record.estimation],
        "outcomes": {phase: dict(sorted(ended.items())) for phase, ended in sorted(record.outcomes.items())},
        "failures": {
            "total": len(record.errors),
            "listed": [_failed(f) for f in record.failures(FAILURES_LISTED)],
        },
        "driver_shift": _driver_shift(record),
    }


def _failed(failure: FailedRollout) -> dict[str, Any]:
    seed = str(failure.noise_seed)
    return asdict(failure) | {"noise_seed": seed, "noise": seed}


def starts_learned(record: JobRecord) -> Learned:
    """What a job's search learned of the starts, for which no rollout need be run again."""
    with Rerunner(record.job) as nobody:
        return learned_of(record.job.id, record, nobody, 0)


def _driver_shift(record: JobRecord) -> dict[str, Any] | None:
    """How far the parametric proposal is from the base; None for methods that have none."""
    proposal = record.proposal
    if record.job.method != "ce" or proposal is None:
        return None
    base = record.problem.base
    outputs = []
    shifts = xi_shifts_sd(record, proposal)
    for k, name in enumerate(XI_OUTPUTS):
        mine = shifts[k :: len(XI_OUTPUTS)]
        outputs.append(
            {
                "output": name,
                "weights": mine.size,
                "rms_shift_sd": float(np.sqrt(np.mean(mine**2))),
                "max_shift_sd": float(np.abs(mine).max()),
            }
        )
    return {
        "outputs": outputs,
        "distance_sd": math.sqrt(2.0 * max(proposal.normals[0][1].kl(base.normals[0][1]), 0.0)),
        "kl_nats": proposal.kl(base),
    }


def xi_shifts_sd(record: JobRecord, proposal: ce.Product) -> np.ndarray:
    """Shift of the mean of each driver weight, (404,), in its standard deviations under the base."""
    base = record.problem.base.normals[0][1]
    return (proposal.normals[0][1].mean - base.mean) / np.sqrt(np.diagonal(base.cov))


def _headline(jobs: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """The job whose estimate heads the report: converged before not, finished before not, then the narrower."""

    def order(job: dict[str, Any]) -> tuple[bool, bool, float]:
        low, high = job["ci"]
        width = (high - low) / job["p"] if job["p"] else math.inf
        return (not job["converged"], not job["finished"], width)

    best = min(jobs, key=order)
    return {
        "job": best["id"],
        "by_method": best["by_method"],
        "answer": best["answer"],
        "answer_interval": best["answer_interval"],
        "settled": best["converged"],
        "p": best["p"],
        "ci": best["ci"],
        "confidence": best["confidence"],
        "rollouts": best["rollouts"]["total"],
    }


def _disagreement(jobs: Sequence[dict[str, Any]]) -> str | None:
    """What to say where two jobs' intervals have nothing in common."""
    known = [job for job in jobs if job["rollouts"]["estimation"]]
    for i, a in enumerate(known):
        for b in known[i + 1 :]:
            if a["ci"][0] > b["ci"][1] or b["ci"][0] > a["ci"][1]:
                return (
                    f"The intervals by {a['by_method']} and by {b['by_method']} have no value in common. At least "
                    "one of the two estimates is wrong: rely on neither before the cause is found. Naive Monte "
                    "Carlo, given more rollouts, decides."
                )
    return None


def _dangerous(rollout: ShownRollout) -> dict[str, Any]:
    failure, trace, job = rollout.failure, rollout.trace, rollout.record.job
    return msgspec.to_builtins(failure) | {
        "job": job.id,
        "method_name": words.METHOD_NAMES.get(job.method, job.method),
        "mode_name": mode_name(failure.mode),
        "steps": None if trace is None else trace.rollout.steps,
        "worst_at_s": None if trace is None else float(trace.time_s[int(np.argmin(trace.measured))]),
    }


def _failure_modes(failures: Failures | None) -> dict[str, Any] | None:
    """The modes without the list of rollouts, of which the report shows some by themselves."""
    if failures is None:
        return None
    modes: dict[str, Any] = msgspec.to_builtins(failures)
    del modes["failures"]
    return modes


def _versions(of_run: str) -> dict[str, str]:
    found = {"tailroad of the run": of_run, "python": platform.python_version()}
    for package in PACKAGES:
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            continue
    return found
