"""`tailroad cancel`, `pause` and `resume`: tell a job what to do."""

from collections.abc import Callable

import click

from service.front.cli.client_options import client_options
from service.front.cli.options import echo_json, json_option
from service.remote.api.objects import Done
from service.remote.client import Client


def _order(name: str, does: str, give: Callable[[Client, str], Done]) -> click.Command:
    @click.command(name, help=does)
    @click.argument("jobs", nargs=-1, required=True, metavar="JOB...")
    @client_options()
    @json_option()
    def command(jobs: tuple[str, ...], client: Client, as_json: bool) -> None:
        for job in jobs:
            done = give(client, job)
            if as_json:
                echo_json(done)

    return command


cancel = _order("cancel", "End each JOB for good; what was run is kept.", Client.cancel)
pause = _order("pause", "Run none of the rollouts of each JOB until it is resumed.", Client.pause)
resume = _order("resume", "Go on with each JOB.", Client.resume)
