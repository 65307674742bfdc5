"""`tailroad estimate`: how probable is the dangerous event?"""

import json
import sys
import time
from datetime import datetime
from pathlib import Path
from typing import Any

import click
import msgspec
from rich.console import Console
from rich.table import Table

import ce
from service.analysis.exposure import exposure_of
from service.analysis.failures.rerun import Rerunner
from service.analysis.risk import Risk, risk_of
from service.analysis.wording import quantity
from service.errors import InputError, WorkerError
from service.evaluation.campaign import Watcher, run_job
from service.evaluation.job import Job, Problem, make_job
from service.evaluation.store import Chunk, RunDirectory
from service.evaluation.summary import Cost, comparisons, json_ready, summary_of
from service.front.cli.ego_options import ego_option
from service.front.cli.main import INTERRUPTED
from service.front.cli.options import (
    core_count,
    finite,
    json_option,
    measure_option,
    noise_mode_option,
    seed_option,
    workers_option,
)
from service.front.cli.progress import progress_bar, stderr
from service.world.egos.open import check_ego, meet_ego
from service.world.safety.measure import with_measure
from service.world.scenario import load_scenario
from service.world.scenario.check import check_road
from service.world.scenario.measures import IMPACT
from service.world.scenario.noise_mode import NoiseMode, with_noise_mode

NOT_PRECISE = 3


@click.command()
@click.argument("scenario", required=False)
@ego_option()
@click.option(
    "--gamma",
    type=float,
    callback=finite,
    help="The event is f <= GAMMA, in the measure's unit; required for a new run.",
)
@measure_option()
@noise_mode_option()
@click.option("--method", "methods", multiple=True, type=click.Choice(ce.METHODS), help="Once for each method wanted; "
              "several are compared.  [default: ce]")  # fmt: skip
@click.option("--budget", type=click.IntRange(1), default=20_000, show_default=True,
              help="Rollouts of each method at most, training included.")  # fmt: skip
@click.option("--rel-error", type=click.FloatRange(0, min_open=True), callback=finite,
              help="Stop when the interval's relative half-width is this small.")  # fmt: skip
@click.option(
    "--confidence", type=click.FloatRange(0, 1, min_open=True, max_open=True), default=0.95, show_default=True
)
@click.option("--iterations", type=click.IntRange(1), help="ce: K.")
@click.option("--samples-per-iteration", type=click.IntRange(10), help="ce: N_k.")
@click.option(
    "--rho",
    type=click.FloatRange(0, 1, min_open=True, max_open=True),
    help="ce: quantile level.  [default: 0.01]",
)
@click.option(
    "--step", type=click.FloatRange(0, 1, min_open=True), help="ce: alpha, the step size.  [default: 0.8]"
)
@click.option("--mean-box", type=click.FloatRange(0, min_open=True), callback=finite,
              help="ce: how far each driver weight's mean may move.  [default: 0.01]")  # fmt: skip
@click.option("--max-kl", type=click.FloatRange(0, min_open=True), callback=finite,
              help="ce: how far the proposal may move from the base, in nats.  [default: no limit]")  # fmt: skip
@workers_option()
@seed_option()
@click.option("--out", type=click.Path(file_okay=False, path_type=Path), help="Run directory.  "
              "[default: runs/SCENARIO-EGO-TIME]")  # fmt: skip
@click.option("--resume", type=click.Path(exists=True, file_okay=False, path_type=Path),
              help="Continue the run in this directory; its own settings hold.")  # fmt: skip
@click.option("--max-failed", type=click.FloatRange(0, 1), callback=finite, default=0.1, show_default=True,
              help="Stop when more than this share of the rollouts fails; 0: at the first, 1: never.")  # fmt: skip
@click.option("--report/--no-report", "with_report", default=True, help="Write the HTML report at the end.")
@json_option()
def command(
    scenario: str | None,
    ego: str,
    gamma: float | None,
    measure: str | None,
    noise_mode: NoiseMode | None,
    methods: tuple[str, ...],
    budget: int,
    rel_error: float | None,
    confidence: float,
    iterations: int | None,
    samples_per_iteration: int | None,
    rho: float | None,
    step: float | None,
    mean_box: float | None,
    max_kl: float | None,
    workers: int | None,
    seed: int,
    out: Path | None,
    resume: Path | None,
    max_failed: float,
    with_report: bool,
    as_json: bool,
) -> None:
    """Estimate p = P0(f(X) <= gamma) of SCENARIO (default: i80-10s) for an ego policy.

    Exit codes: 0 done, 2 bad input, 3 the precision asked for was not reached, 130 interrupted (what was run is kept;
    continue with --resume).
    """
    if resume is not None:
        if scenario is not None or out is not None:
            raise InputError("--resume takes everything from the run directory; leave out SCENARIO and --out")
        store = RunDirectory.open(resume)
        for job in store.jobs:
            check_ego(job.ego)  # a run directory may come from someone else
    else:
        if gamma is None:
            raise InputError(
                "give the event's threshold in the measure's unit, as in --gamma 0.5 (seconds to collision), or "
                f"--gamma 0 with the measure {IMPACT} (a contact)"
            )
        name = scenario or "i80-10s"
        common = {"rel_error": rel_error, "confidence": confidence, "budget": budget}
        search = {
            "iterations": iterations,
            "samples_per_iteration": samples_per_iteration,
            "rho": rho,
            "step": step,
            "mean_box": mean_box,
            "max_kl": max_kl,
        }
        loaded = load_scenario(name)
        if measure is not None:
            loaded = with_measure(loaded, measure)
        loaded = with_noise_mode(loaded, noise_mode, name)
        corridor = check_road(loaded, name)
        jobs = []
        for method in dict.fromkeys(methods or ("ce",)):
            options: dict[str, Any] = dict(common)
            if method == "ce":
                options |= {k: v for k, v in search.items() if v is not None}
            jobs.append(make_job(loaded, ego, gamma, method, seed, options))
        meet_ego(ego, loaded, corridor)
        store = RunDirectory.create(out or _default_folder(loaded.name, ego), tuple(jobs))
    with store:
        code = _run(store, workers or core_count(), max_failed, with_report, as_json)
    sys.exit(code)


def _default_folder(scenario: str, ego: str) -> Path:
    return Path("runs") / f"{scenario}-{ego}-{datetime.now():%Y%m%d-%H%M%S}"


def _run(store: RunDirectory, workers: int, max_failed: float, with_report: bool, as_json: bool) -> int:
    estimates: dict[str, ce.Estimate] = {}
    costs: dict[str, Cost] = {}
    try:
        for job in store.jobs:
            costs[job.id] = Cost(workers)
            estimates[job.id] = _run_one(store, job, workers, max_failed, costs[job.id])
    except KeyboardInterrupt:
        stderr.print(
            f"\nInterrupted; what was run is kept. Continue with: tailroad estimate --resume {store.path}"
        )
        return INTERRUPTED
    summaries = [summary_of(job, estimates[job.id], costs[job.id]) for job in store.jobs]
    risks = _risks(store, estimates)
    for summary in summaries:
        summary["risk"] = json_ready(msgspec.to_builtins(risks.get(summary["method"])))
    compared = comparisons(store.jobs, estimates)
    result = summaries[0] if len(summaries) == 1 else {"estimates": summaries, "comparison": compared}
    (store.path / "result.json").write_text(json.dumps(result, indent=2) + "\n", encoding="utf-8")
    if as_json:
        click.echo(json.dumps(result, indent=2))
    else:
        _print(summaries, compared)
        for method, risk in risks.items():
            click.echo(f"As a rate, by {method}: {risk.summary}")
    if with_report:
        from service.analysis.report import write_report

        path = write_report(store, workers=workers)
        (stderr.print if as_json else click.echo)(f"Report: {path}")
    missed = any(e.rel_error is not None and not e.converged for e in estimates.values())
    return NOT_PRECISE if missed else 0


def _risks(store: RunDirectory, estimates: dict[str, ce.Estimate]) -> dict[str, Risk]:
    """The estimates as rates, by method; nothing where no rollout can be run to measure how far the ego drives."""
    job = store.jobs[0]
    try:
        with Rerunner(job) as rerunner:
            exposure = exposure_of(job, Problem(job).base, rerunner, folder=store.path)
    except WorkerError as error:
        stderr.print(f"No rate per million km: {error}")
        exposure = None
    return (
        {} if exposure is None else {job.id: risk_of(job, estimates[job.id], exposure) for job in store.jobs}
    )


def _run_one(store: RunDirectory, job: Job, workers: int, max_failed: float, cost: Cost) -> ce.Estimate:
    began = time.perf_counter()
    with progress_bar() as bar:
        task = bar.add_task(f"{job.method}: starting {workers} workers", total=None, note="")

        def on_job(job: Job, total: int) -> None:
            bar.update(task, total=total, description=job.method)
            if not stderr.is_terminal:
                click.echo(
                    f"{job.method}: at most {total:,} rollouts on {workers} workers, run {store.path}",
                    err=True,
                )

        def on_chunk(chunk: Chunk, replayed: bool) -> None:
            cost.add(chunk.worker_s, float(chunk.steps.sum()) * job.scenario.time.step_s)
            bar.update(task, advance=chunk.stop - chunk.start)

        def on_record(state: Any, record: ce.TrainingRecord | ce.EstimationRecord) -> None:
            if isinstance(record, ce.TrainingRecord):
                note = f"search {record.iteration + 1}: gamma_k {record.gamma_k:.3g}, ESS {record.ess:.0f}"
            else:
                note = f"p = {record.p:.3g} [{record.low:.2g}, {record.high:.2g}]"
            bar.update(task, note=note)

        estimate = run_job(store, job, workers, Watcher(on_job, on_chunk, on_record), max_failed)
    cost.wall_s = time.perf_counter() - began
    return estimate


def _print(summaries: list[dict[str, Any]], compared: list[dict[str, Any]]) -> None:
    console = Console()
    first = summaries[0]
    console.print(
        f"\np = P0(f <= {quantity(first['gamma'], first['unit'])}), f the {first['measure']}, "
        f"scenario {first['scenario']}, ego {first['ego']}, seed {first['seed']}"
    )
    table = Table("", *[s["method"] for s in summaries])
    against = {c["method"]: c for c in compared}

    def row(label: str, values: list[str]) -> None:
        table.add_row(label, *values)

    row("p", [_p(s) for s in summaries])
    row(f"{first['confidence']:.0%} interval", [f"{s['ci'][0]:.3g} to {s['ci'][1]:.3g}" for s in summaries])
    row("rollouts", [f"{s['rollouts']['total']:,}" for s in summaries])
    row("  of them training", [f"{s['rollouts']['training']:,}" for s in summaries])
    row("events", [f"{s['events']:,}" for s in summaries])
    row("effective events (ESS)", [f"{s['ess']:.1f}" for s in summaries])
    row("largest weight share", [f"{s['max_weight_share']:.1%}" for s in summaries])
    row("failed rollouts", [f"{s['rollouts']['failed']:,}" for s in summaries])
    if compared:
        for label, key in (
            ("ratio of rare events", "ratio_of_rare_events"),
            ("ratio of variances, training left out", "ratio_of_variances"),
            ("efficiency, training counted", "efficiency"),
        ):
            row(label, [_ratio(against.get(s["method"]), key) for s in summaries])
    row("worker time", [f"{s['worker_s']:.0f} s" for s in summaries])
    row("x real time a core", [f"{s['x_realtime_per_core'] or 0.0:.0f}" for s in summaries])
    console.print(table)
    for s in summaries:
        for warning in s["warnings"]:
            console.print(
                f"[yellow]{s['method']}: {warning['name']}[/yellow]: {warning['message']}. Remedy: {warning['remedy']}"
            )


def _p(summary: dict[str, Any]) -> str:
    if summary["p"] is None:
        return "not known"
    trust = "" if summary["variance_reliable"] else "\n(see warnings: rely on the interval)"
    return f"{summary['p']:.3g} ± {summary['std_error']:.2g}{trust}"


def _ratio(comparison: dict[str, Any] | None, key: str) -> str:
    if comparison is None:
        return "1"
    if key != "ratio_of_rare_events" and not comparison["variance_reliable"]:
        return "not known: see warnings"
    return "-" if comparison[key] is None else f"{comparison[key]:.2f}"
