"""`tailroad estimate`: how probable is the dangerous event?"""

import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import click
from rich.console import Console
from rich.table import Table

from service.analysis.failures.rerun import Rerunners
from service.analysis.risk import Risk
from service.analysis.run import Interrupted, estimate
from service.analysis.run import resume as go_on
from service.analysis.run.bars import Shown, progress_bar, stderr
from service.analysis.run.question import METHOD
from service.analysis.wording import quantity, treatment
from service.errors import InputError, WorkerError
from service.evaluation.cores import core_count
from service.evaluation.options import FLAGS_OF_CE, METHODS
from service.evaluation.pool import InSumo
from service.front.cli.ego_options import ego_option
from service.front.cli.main import INTERRUPTED
from service.front.cli.options import (
    FOLDER,
    finite,
    in_sumo_option,
    json_option,
    max_failed_option,
    seed_option,
    workers_option,
)
from service.front.cli.question_options import method_options, option_of, scenario_options
from service.front.cli.tables import side_by_side, whole
from service.world.scenario.measures import IMPACT

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
@scenario_options()
@click.option("--method", "methods", multiple=True, type=click.Choice(METHODS), help="Once for each method wanted; "
              "several are compared.  [default: auto]")  # fmt: skip
@method_options(budget="Rollouts of each method at most, training included.")
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
@click.option("--committor", help="paths: start from the committor of this run directory or file, and train none; "
              "own: train one.  [default: what comes with tailroad for the scenario, where anything does]")  # fmt: skip
@workers_option()
@seed_option()
@click.option("--out", type=FOLDER, help="Run directory.  "
              "[default: runs/SCENARIO-EGO-TIME]")  # fmt: skip
@click.option("--resume", type=click.Path(exists=True, file_okay=False, path_type=Path),
              help="Continue the run in this directory; its own settings hold.")  # fmt: skip
@max_failed_option()
@click.option("--report/--no-report", "with_report", default=True, help="Write the HTML report at the end.")
@in_sumo_option()
@json_option()
def command(
    scenario: str | None,
    ego: str,
    gamma: float | None,
    methods: tuple[str, ...],
    options: tuple[str, ...],
    workers: int | None,
    out: Path | None,
    resume: Path | None,
    max_failed: float,
    in_sumo: InSumo,
    with_report: bool,
    as_json: bool,
    **asked: Any,
) -> None:
    """Estimate p = P0(f(X) <= gamma) of SCENARIO (default: i80-10s) for an ego policy.

    Exit codes: 0 done, 2 bad input, 3 the precision asked for was not reached, 130 interrupted (what was run is kept;
    continue with --resume).
    """
    count = workers or core_count()
    with progress_bar() as bar:
        how: dict[str, Any] = {
            "workers": count,
            "progress": Shown(bar, count),
            "max_failed": max_failed,
            "in_sumo": in_sumo,
        }
        try:
            if resume is not None:
                if scenario is not None or out is not None:
                    raise InputError(
                        "--resume takes everything from the run directory; leave out SCENARIO and --out"
                    )
                run = go_on(resume, **how)
            else:
                if gamma is None:
                    raise InputError(
                        "give the event's threshold in the measure's unit, as in --gamma 0.5 (seconds to collision), "
                        f"or --gamma 0 with the measure {IMPACT} (a contact)"
                    )
                flags = {name: asked.pop(name) for name in FLAGS_OF_CE}
                run = estimate(
                    scenario or "i80-10s",
                    ego,
                    gamma=gamma,
                    method=methods or METHOD,
                    options={k: v for k, v in flags.items() if v is not None} | dict(map(option_of, options)),
                    out=out,
                    new=True,
                    **how,
                    **asked,
                )
        except Interrupted as stopped:
            stderr.print(
                f"\nInterrupted; what was run is kept. Continue with: tailroad estimate --resume {stopped.path}"
            )
            sys.exit(INTERRUPTED)
    with Rerunners(run.workers) as opened:
        try:
            risks = run.risks(opened)
        except WorkerError as error:
            stderr.print(f"No rate per million km: {error}")
            risks = {}
        result = run.save(risks)
        if as_json:
            click.echo(json.dumps(result, indent=2))
        else:
            _print(result.get("estimates", [result]), result.get("comparison", []))
            _print_rates(risks)
        if with_report:
            (stderr.print if as_json else click.echo)(f"Report: {run.report(opened=opened)}")
    sys.exit(NOT_PRECISE if run.imprecise else 0)


def _print(summaries: list[dict[str, Any]], compared: list[dict[str, Any]]) -> None:
    """Each threshold and seed under its own heading, its methods beside each other; then what to beware of."""
    console = Console()
    questions: dict[tuple[float, int], list[dict[str, Any]]] = {}
    for s in summaries:
        questions.setdefault((s["gamma"], s["seed"]), []).append(s)
    for asked in questions.values():
        first = asked[0]
        console.print(
            f"\np = P0(f <= {quantity(first['gamma'], first['unit'])}), f the {first['measure']}, "
            f"scenario {first['scenario']}, ego {first['ego']}, seed {first['seed']}"
        )
        for beside in side_by_side(asked, 2):
            console.print(_table(beside, {c["method"]: c for c in compared}))
    for s in summaries:
        if treated := treatment(s["rollouts"]["failed"], s["rollouts"]["total"]):
            console.print(f"[yellow]{_job(s)}: {treated}[/yellow]", highlight=False)
        for warning in s["warnings"]:
            console.print(
                f"[yellow]{_job(s)}: {warning['name']}[/yellow]: {warning['message']}. Remedy: {warning['remedy']}"
            )


def _print_rates(risks: dict[str, Risk]) -> None:
    for job, risk in risks.items():
        Console().print(f"As a rate, by {job}: {risk.summary}", highlight=False, markup=False)


def _table(summaries: Sequence[dict[str, Any]], against: dict[str, dict[str, Any]]) -> Table:
    """What jobs of one question came to, a column each."""
    table = Table("", *[whole(_job(s)) for s in summaries])

    def row(label: str, values: list[str]) -> None:
        table.add_row(label, *values)

    row("p", [_p(s) for s in summaries])
    level = summaries[0]["confidence"]
    row(f"{level:.0%} interval", [f"{s['ci'][0]:.3g} to {s['ci'][1]:.3g}" for s in summaries])
    row("rollouts", [f"{s['rollouts']['total']:,}" for s in summaries])
    row("  of them training", [f"{s['rollouts']['training']:,}" for s in summaries])
    row("events", [f"{s['events']:,}" for s in summaries])
    row("effective events (ESS)", [f"{s['ess']:.1f}" for s in summaries])
    row("largest weight share", [f"{s['max_weight_share']:.1%}" for s in summaries])
    row("failed rollouts", [f"{s['rollouts']['failed']:,}" for s in summaries])
    for outcome in dict.fromkeys(e["outcome"] for s in summaries for e in s["endings"]):
        row(f"ended with {outcome}", [_ending(s, outcome) for s in summaries])
        for kind in dict.fromkeys(kind for s in summaries for kind in _contacts(s, outcome)):
            row(f"  {kind}", [_chance(_contacts(s, outcome).get(kind)) for s in summaries])
    for mps in dict.fromkeys(i["mps"] for s in summaries for i in s["impacts"] if i["rollouts"]):
        if mps == -summaries[0]["gamma"]:
            continue  # p itself
        row(
            f"contact at {mps:g} m/s or more" if mps else "contact",
            [_chance(next((i for i in s["impacts"] if i["mps"] == mps), None)) for s in summaries],
        )
    if against:
        for label, key in (
            ("ratio of rare events", "ratio_of_rare_events"),
            ("ratio of variances, training left out", "ratio_of_variances"),
            ("efficiency, training counted", "efficiency"),
        ):
            row(label, [_ratio(against.get(_job(s)), key) for s in summaries])
    row("rollouts that SUMO drove", [f"{s['in_sumo']:,}" for s in summaries])
    row("worker time", [f"{s['worker_s']:.0f} s" for s in summaries])
    row("x real time a core", [f"{s['x_realtime_per_core'] or 0.0:.0f}" for s in summaries])
    return table


def _job(summary: dict[str, Any]) -> str:
    """The job's id within its run."""
    return summary.get("job", summary["method"])


def _p(summary: dict[str, Any]) -> str:
    if summary["p"] is None:
        return "not known"
    trust = "" if summary["variance_reliable"] else "\n(see the warnings)"
    return f"{summary['p']:.3g} ± {summary['std_error']:.2g}{trust}"


def _ending(summary: dict[str, Any], outcome: str) -> str:
    """p of an ending, its interval, and the rollouts that ended so."""
    return _chance(next((e for e in summary["endings"] if e["outcome"] == outcome), None))


def _contacts(summary: dict[str, Any], outcome: str) -> dict[str, dict[str, Any]]:
    """The contacts of an ending, by their names."""
    listed = (e["contacts"] for e in summary["endings"] if e["outcome"] == outcome)
    return {kind["name"]: kind for kind in next(listed, ())}


def _chance(found: dict[str, Any] | None) -> str:
    if found is None or found["p"] is None:
        return "none"
    return f"{found['p']:.3g}\n{found['ci'][0]:.2g} to {found['ci'][1]:.2g}\n({found['rollouts']:,})"


def _ratio(comparison: dict[str, Any] | None, key: str) -> str:
    if comparison is None:
        return "1"
    if key != "ratio_of_rare_events" and not comparison["variance_reliable"]:
        return "not known:\nsee warnings"
    return "-" if comparison[key] is None else f"{comparison[key]:.2f}"
