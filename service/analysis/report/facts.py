"""From a run's records to the facts of its report: report.json, and what the page is made from."""

import math
import platform
from collections.abc import Sequence
from datetime import datetime
from importlib.metadata import PackageNotFoundError, version
from typing import Any

import msgspec
import numpy as np

import ce
from service.analysis.estimate_parts import EstimateWarning, Rollouts
from service.analysis.exposure import Exposure
from service.analysis.failures.examine import mode_name
from service.analysis.failures.objects import Failures
from service.analysis.failures.rerun import Rerunner
from service.analysis.learned.learn import learned_of
from service.analysis.learned.objects import Learned
from service.analysis.report import words
from service.analysis.report.dangerous import Findings, ShownRollout
from service.analysis.report.objects import (
    AgainstNaive,
    Dangerous,
    DriverShift,
    EstimateTrace,
    EstimationStep,
    FailedRollout,
    FailedRollouts,
    GammaCurve,
    Headline,
    JobFacts,
    ModesFacts,
    OutputShift,
    Progress,
    Report,
    ScenarioFacts,
    TrainingStep,
)
from service.analysis.risk import POLICE_REPORTED, Baseline, Risk, event_of, rate_of
from service.analysis.thresholds import curve_gammas
from service.analysis.wording import treatment
from service.evaluation import record as records_of_jobs
from service.evaluation.doubts import DOUBTS, told
from service.evaluation.job import Job
from service.evaluation.record import JobRecord
from service.evaluation.summary import Cost, comparisons, json_ready, summary_of, withheld_for
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
    """The report's facts as JSON: what `service.analysis.report.objects.Report` declares.

    run: what the run is called
    now: when the report is made
    baseline: what the risk is held against
    served: the run is a job of a service

    Numbers that are not finite are None.
    """
    known = [r for r in records if r.estimate.estimation_rollouts]
    compared = comparisons([r.job for r in known], {r.job.id: r.estimate for r in known})
    against_naive = {c["method"]: AgainstNaive(**c) for c in compared}
    gammas = curve_gammas(records)
    apart = {r.job.id: words.apart(r.job, [other.job for other in records]) for r in records}
    jobs = tuple(_job(r, against_naive.get(r.job.id), gammas, apart[r.job.id]) for r in records)
    first = records[0].job
    headline = _headline([job for job in jobs if job.gamma == first.gamma])
    report = Report(
        made=now.isoformat(timespec="seconds"),
        run=run,
        served=served,
        question=words.question(first),
        headline=headline,
        disagreement=_disagreement(jobs),
        scenario=_scenario(records[0]),
        jobs=jobs,
        risk=_risk(headline, jobs, first, seen.exposure, baseline),
        learned={r.job.id: seen.learned.get(r.job.id) or starts_learned(r) for r in records},
        failure_modes=_failure_modes(seen.failures),
        dangerous=tuple(_dangerous(r, apart[r.record.job.id]) for r in seen.rollouts),
        commands=tuple(words.commands([r.job for r in records])),
        versions=_versions(first.tailroad),
        severity=seen.severity,
        prevention=seen.prevention,
        coverage=seen.coverage,
    )
    facts: dict[str, Any] = json_ready(msgspec.to_builtins(report, enc_hook=np.generic.item))
    msgspec.convert(facts, Report)  # what is written is what the published schema says
    return facts


def _scenario(record: JobRecord) -> ScenarioFacts:
    job, scenario = record.job, record.job.scenario
    kind = measure_kind(scenario.safety.measure)
    return ScenarioFacts(
        name=scenario.name,
        description=scenario.description,
        built_in=words.is_built_in(job),
        road=words.road_name(job),
        ego=job.ego,
        gamma=job.gamma,
        measure=scenario.safety.measure,
        measure_words=kind.words.rstrip(","),
        unit=kind.unit,
        horizon_s=scenario.time.horizon_s,
        step_s=scenario.time.step_s,
        vehicles=len(scenario.vehicles),
        drivers=scenario.drivers.weights,
        noise=scenario.drivers.noise_mode,
        noise_mode=scenario.drivers.noise_mode,
        dimension=record.problem.base.dim,
        drivers_sha256=job.weights_sha256,
        file=to_written(msgspec.to_builtins(scenario)),
    )


def _risk(
    headline: Headline, jobs: Sequence[JobFacts], job: Job, exposure: Exposure | None, baseline: Baseline
) -> Risk | None:
    """The headline's p as a rate; None where the kilometres are not known."""
    if exposure is None:
        return None
    best = next(one for one in jobs if one.id == headline.job)
    withheld = withheld_for((w.name for w in best.warnings), best.rollouts.training)
    return rate_of(headline.p, headline.ci, headline.confidence, exposure, event_of(job), baseline, withheld)


def _job(record: JobRecord, against_naive: AgainstNaive | None, gammas: np.ndarray, apart: str) -> JobFacts:
    job, estimate = record.job, record.estimate
    cost = Cost(workers=0)
    cost.add(record.worker_s, record.sim_s, record.in_sumo)
    summary = summary_of(job, estimate, cost, record.endings)
    del summary["workers"], summary["wall_s"]  # of a sitting, which the record does not know
    answer, interval = words.answer(summary)
    trace, curve = estimate.trace(), estimate.curve(gammas)
    parts: dict[str, Any] = {
        "ci": tuple(summary["ci"]),
        "rollouts": Rollouts(**summary["rollouts"]),
        "warnings": tuple(EstimateWarning(**warning) for warning in summary["warnings"]),
    }
    return JobFacts(
        **summary | parts,
        id=job.id,
        method_name=words.METHOD_NAMES.get(job.method, job.method) + apart,
        method_used=estimate.method,
        by_method=words.BY_METHOD.get(job.method, job.method) + apart,
        answer=answer,
        answer_interval=interval,
        finished=estimate.finished,
        progress=Progress(planned=record.planned, recorded=record.recorded, counted=estimate.rollouts),
        options_without_flag=tuple(words.options_without_flag(job)),
        stream_seed=str(record.problem.stream_seed),  # 64 bits: too many for a JSON number
        pareto_k=estimate.pareto_k,
        against_naive=against_naive,
        trace=EstimateTrace(
            rollouts=_row(trace.rollouts + estimate.training_rollouts),
            p=_row(trace.p),
            low=_row(trace.low),
            high=_row(trace.high),
        ),
        curve=GammaCurve(
            gamma=_row(curve.gammas),
            p=_row(curve.p),
            low=_row(curve.low),
            high=_row(curve.high),
            events=_row(curve.events),
        ),
        training=tuple(TrainingStep(**msgspec.structs.asdict(r)) for r in record.training),
        estimation=tuple(EstimationStep(**msgspec.structs.asdict(r)) for r in record.estimation),
        outcomes={phase: dict(sorted(ended.items())) for phase, ended in sorted(record.outcomes.items())},
        failures=FailedRollouts(
            total=len(record.errors), listed=tuple(_failed(f) for f in record.failures(FAILURES_LISTED))
        ),
        driver_shift=_driver_shift(record),
    )


def _row(values: np.ndarray) -> tuple[Any, ...]:
    return tuple(values.tolist())


def _failed(failure: records_of_jobs.FailedRollout) -> FailedRollout:
    seed = str(failure.noise_seed)
    return FailedRollout(
        phase=failure.phase,
        iteration=failure.iteration,
        row=failure.row,
        noise=seed,
        noise_seed=seed,
        reason=failure.reason,
    )


def starts_learned(record: JobRecord) -> Learned:
    """What a job's search learned of the starts, for which no rollout need be run again."""
    with Rerunner(record.job) as nobody:
        return learned_of(record.job.id, record, nobody, 0)


def _driver_shift(record: JobRecord) -> DriverShift | None:
    """How far the parametric proposal is from the base; None for methods that have none."""
    proposal = record.proposal
    if record.job.method != "ce" or proposal is None:
        return None
    base = record.problem.base
    shifts = xi_shifts_sd(record, proposal)
    return DriverShift(
        outputs=tuple(_output(name, shifts[k :: len(XI_OUTPUTS)]) for k, name in enumerate(XI_OUTPUTS)),
        distance_sd=math.sqrt(2.0 * max(proposal.normals[0][1].kl(base.normals[0][1]), 0.0)),
        kl_nats=proposal.kl(base),
    )


def _output(name: str, shifts: np.ndarray) -> OutputShift:
    return OutputShift(
        output=name,
        weights=shifts.size,
        rms_shift_sd=float(np.sqrt(np.mean(shifts**2))),
        max_shift_sd=float(np.abs(shifts).max()),
    )


def xi_shifts_sd(record: JobRecord, proposal: ce.Product) -> np.ndarray:
    """Shift of the mean of each driver weight, (404,), in its standard deviations under the base."""
    base = record.problem.base.normals[0][1]
    return (proposal.normals[0][1].mean - base.mean) / np.sqrt(np.diagonal(base.cov))


def _headline(jobs: Sequence[JobFacts]) -> Headline:
    """The job whose estimate heads the report: converged before not, finished before not, then the narrower."""

    def order(job: JobFacts) -> tuple[bool, bool, float]:
        low, high = job.ci
        width = (high - low) / job.p if job.p else math.inf
        return (not job.converged, not job.finished, width)

    best = min(jobs, key=order)
    doubt = "; ".join(told(w.name, w.message, w.remedy) for w in best.warnings if w.name in DOUBTS)
    return Headline(
        job=best.id,
        by_method=best.by_method,
        answer=best.answer,
        answer_interval=best.answer_interval,
        settled=best.converged and not doubt,
        p=best.p,
        ci=best.ci,
        confidence=best.confidence,
        rollouts=best.rollouts.total,
        failures=treatment(best.rollouts.failed, best.rollouts.total),
        doubt=doubt,
    )


def _disagreement(jobs: Sequence[JobFacts]) -> str | None:
    """What to say where two jobs of one threshold have intervals with nothing in common."""
    known = [job for job in jobs if job.rollouts.estimation]
    for i, a in enumerate(known):
        for b in known[i + 1 :]:
            if a.gamma == b.gamma and (a.ci[0] > b.ci[1] or b.ci[0] > a.ci[1]):
                return (
                    f"The intervals by {a.by_method} and by {b.by_method} have no value in common. At least "
                    "one of the two estimates is wrong: rely on neither before the cause is found. Naive Monte "
                    "Carlo, given more rollouts, decides."
                )
    return None


def _dangerous(rollout: ShownRollout, apart: str) -> Dangerous:
    failure, trace, job = rollout.failure, rollout.trace, rollout.record.job
    return Dangerous(
        **msgspec.structs.asdict(failure),
        job=job.id,
        method_name=words.METHOD_NAMES.get(job.method, job.method) + apart,
        mode_name=mode_name(failure.mode),
        steps=None if trace is None else trace.rollout.steps,
        worst_at_s=None if trace is None else float(trace.time_s[int(np.argmin(trace.measured))]),
    )


def _failure_modes(failures: Failures | None) -> ModesFacts | None:
    """The modes without the list of rollouts, of which the report shows some by themselves."""
    if failures is None:
        return None
    modes = msgspec.structs.asdict(failures)
    del modes["failures"]
    return ModesFacts(**modes)


def _versions(of_run: str) -> dict[str, str]:
    found = {"tailroad of the run": of_run, "python": platform.python_version()}
    for package in PACKAGES:
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            continue
    return found
