"""`tailroad jobs`: the jobs of a service."""

import click
from rich.console import Console
from rich.table import Table

from service.analysis.wording import quantity
from service.front.cli.client_options import client_options
from service.front.cli.options import echo_json, json_option
from service.front.cli.tables import whole
from service.remote.api.objects import STATUSES, Job, Jobs
from service.remote.client import Client


@click.command()
@click.option("--status", type=click.Choice(STATUSES),
              help="Only jobs of this status.")  # fmt: skip
@click.option("--label", help="Only jobs whose label holds this text.")
@click.option("--limit", type=click.IntRange(1), default=100, show_default=True, help="The last so many.")
@client_options()
@json_option()
def command(status: str | None, label: str | None, limit: int, client: Client, as_json: bool) -> None:
    """List jobs in the order of submission."""
    found = [
        job
        for job in client.all_jobs()
        if (status is None or job.status == status) and (label is None or label in job.label)
    ][-limit:]
    if as_json:
        echo_json(Jobs(items=tuple(found), next=None))
        return
    table = Table(
        whole("job"),
        "scenario\nego",
        whole("gamma\nmethod"),
        "status",
        whole("rollouts"),
        "label",
    )
    for job in found:
        event = quantity(job.gamma, job.unit)
        table.add_row(
            job.id,
            f"{job.scenario}\n{job.ego}",
            f"{event}\n{job.method}",
            status_text(job),
            counted(job).replace(" of ", "\nof "),
            job.label,
        )
    Console().print(table)


def status_text(job: Job) -> str:
    return f"{job.status}: {job.reason}" if job.reason else job.status


def counted(job: Job) -> str:
    """Rollouts of those at most, where the job is not over."""
    budget = job.options.get("budget")
    of = f" of {budget:,}" if isinstance(budget, int) else ""
    return "" if job.rollouts is None else f"{job.rollouts:,}{of}"
