"""`tailroad health`: does the service answer?"""

import sys

import click

from service.front.cli.client_options import client_options
from service.front.cli.options import echo_json, json_option
from service.remote.client import Client, NoAnswer, Refused

UNWELL = 1


@click.command()
@click.option("--workers", type=click.IntRange(0), default=0, show_default=True,
              help="Connected workers that are wanted at least.")  # fmt: skip
@client_options()
@json_option()
def command(workers: int, client: Client, as_json: bool) -> None:
    """Ask whether the service can do its work. Exit codes: 0 it can, 1 it cannot or nobody answers."""
    try:
        health = client.health()
    except (NoAnswer, Refused) as error:
        click.echo(f"not well: {error}", err=True)
        sys.exit(UNWELL)
    if as_json:
        echo_json(health)
    else:
        click.echo(
            f"well: tailroad {health.tailroad}, up {health.uptime_s:.0f} s, {health.workers} workers with "
            f"{health.procs} processes, {health.open_jobs} open jobs"
        )
    sys.exit(0 if health.workers >= workers else UNWELL)
