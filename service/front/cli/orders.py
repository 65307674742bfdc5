"""`tailroad cancel`, `pause` and `resume`: tell a job what to do."""

from collections.abc import Callable

import click

from service.front.cli.client_options import client_options
from service.front.cli.options import echo_json, json_option
from service.remote.api.objects import Done
from service.remote.client import Client


def _order(give: Callable[[Client, str], Done]) -> Callable[[Callable[[], None]], click.Command]:
    """A command that gives each of its jobs an order; its name and help are those of the function below it."""

    def made(told: Callable[[], None]) -> click.Command:
        @click.command(told.__name__, help=told.__doc__)
        @click.argument("jobs", nargs=-1, required=True, metavar="JOB...")
        @client_options()
        @json_option()
        def command(jobs: tuple[str, ...], client: Client, as_json: bool) -> None:
            for job in jobs:
                done = give(client, job)
                if as_json:
                    echo_json(done)

        return command

    return made


@_order(Client.cancel)
def cancel() -> None:
    """End each JOB for good; what was run is kept."""


@_order(Client.pause)
def pause() -> None:
    """Run none of the rollouts of each JOB until it is resumed."""


@_order(Client.resume)
def resume() -> None:
    """Go on with each JOB."""
