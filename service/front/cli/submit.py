"""`tailroad submit`: give a job to a service."""

from typing import Any

import click

from service.front.cli.client_options import client_options
from service.front.cli.options import (
    echo_json,
    finite,
    json_option,
    max_failed_option,
    seed_option,
)
from service.front.cli.question_options import method_options, option_of, scenario_options
from service.remote.client import Client
from service.remote.client.service import as_sent

METHODS = ("auto", "naive", "ce", "mixture", "splitting")


@click.command()
@click.argument("scenario", default="i80-10s")
@click.option(
    "--ego", default="lidar", show_default=True, help="One of those that `tailroad get egos` lists."
)
@click.option(
    "--gamma",
    type=float,
    callback=finite,
    required=True,
    help="The event is f <= GAMMA, in the measure's unit.",
)
@scenario_options()
@click.option("--method", type=click.Choice(METHODS), default="auto", show_default=True)
@method_options(budget="Rollouts at most, training included.")
@seed_option()
@click.option("--priority", type=click.IntRange(-100, 100), default=0, show_default=True,
              help="Of two jobs the one of higher priority goes first.")  # fmt: skip
@click.option("--weight", type=click.FloatRange(0.01, 100), callback=finite, default=1.0, show_default=True,
              help="Share of the workers among jobs of one priority.")  # fmt: skip
@max_failed_option()
@click.option("--label", default="", help="Words of your own, to find the job by.")
@client_options()
@json_option()
def command(scenario: str, options: tuple[str, ...], client: Client, as_json: bool, **others: Any) -> None:
    """Submit a job on SCENARIO, a name that the service lists or the file of an own scenario, and print its id.

    A file is sent as it is: its road and driver weights must be some that the service lists (`tailroad get scenarios`).
    """
    job = client.submit(as_sent(scenario), options=dict(map(option_of, options)), **others)
    if as_json:
        echo_json(job)
    else:
        click.echo(job.id)
