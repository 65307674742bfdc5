"""`tailroad show JOB`: a job and its estimate so far."""

import click
import msgspec
from rich.console import Console
from rich.table import Table

from service.analysis.wording import quantity, treatment
from service.evaluation.summary import ContactKind, Ending
from service.front.cli.client_options import client_options
from service.front.cli.jobs import counted, status_text
from service.front.cli.options import echo_json, finite, json_option
from service.remote.api.objects import Estimate, Job
from service.remote.client import Client


@click.command()
@click.argument("job")
@click.option("--gamma", type=float, callback=finite, help="Another threshold.  [default: the job's]")
@click.option("--confidence", type=click.FloatRange(0, 1, min_open=True, max_open=True),
              help="Of the interval.  [default: the job's]")  # fmt: skip
@client_options()
@json_option()
def command(job: str, gamma: float | None, confidence: float | None, client: Client, as_json: bool) -> None:
    """Show JOB and its estimate so far, at another threshold or confidence if wanted."""
    found, estimate = client.job(job), client.estimate(job, gamma, confidence)
    if as_json:
        both = {"job": msgspec.to_builtins(found), "estimate": msgspec.to_builtins(estimate)}
        echo_json(msgspec.json.encode(both))
        return
    console, table = Console(), Table(show_header=False)
    rows = {
        "job": f"{found.id}  {found.label}",
        "status": status_text(found),
        "rollouts": counted(found) or f"{estimate.rollouts.total:,}",
        "question": f"p = P0(f <= {quantity(estimate.gamma, estimate.unit)}), {found.scenario}, ego {found.ego}, "
        f"{found.method}, seed {found.seed}",
        "p": _p(found, estimate),
        f"{estimate.confidence:.0%} interval": f"{estimate.ci[0]:.3g} to {estimate.ci[1]:.3g}",
        "events": f"{estimate.events:,}",
        "worker time": f"{estimate.worker_s:.0f} s",
    }
    for ending in estimate.endings:
        rows[f"ended with {ending.outcome}"] = _chance(ending)
        rows |= {f"  {kind.name}": _chance(kind) for kind in ending.contacts}
    for name, value in rows.items():
        table.add_row(name, value)
    console.print(table)
    for warning in estimate.warnings:
        console.print(f"[yellow]{warning.name}[/yellow]: {warning.message}. Remedy: {warning.remedy}")
    for worker, why in found.refusals.items():
        console.print(f"[yellow]worker {worker}[/yellow] cannot run it: {why}", highlight=False)


def _chance(one: Ending | ContactKind) -> str:
    p = "not known" if one.p is None else f"{one.p:.3g}, {one.ci[0]:.2g} to {one.ci[1]:.2g}"
    return f"{p} ({one.rollouts:,})"


def _p(job: Job, estimate: Estimate) -> str:
    """p with its standard error, and how failed rollouts were treated in it."""
    if job.status == "failed":
        return "withheld: the job has failed"
    if estimate.p is None:
        return "not known"
    doubt = (
        "\nDISPUTED: workers disagree on some of its rollouts; a replay on the service's machine settles it"
        if job.disputed
        else ""
    )
    treated = treatment(estimate.rollouts.failed, estimate.rollouts.total)
    return f"{estimate.p:.3g} ± {estimate.std_error or 0.0:.2g}" + doubt + (f"\n{treated}" if treated else "")
