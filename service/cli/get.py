"""`tailroad get KEY`: anything that a service answers, as JSON."""

from pathlib import Path

import click

from service.cli.client_options import client_options, echo_json
from service.client import Client


@click.command()
@click.argument("key")
@click.option("--body", type=click.Path(exists=True, dir_okay=False, path_type=Path),
              help="File with JSON to send with it.")  # fmt: skip
@click.option("--json", "as_json", is_flag=True, help="The answer is JSON in any case.")
@client_options()
def command(key: str, body: Path | None, as_json: bool, client: Client) -> None:
    """Print what the service answers at KEY, as in jobs/JOB/estimate?gamma=0.14;confidence=0.95.

    `tailroad get about` lists the keys, `tailroad get schemas/NAME` prints the JSON Schema of what they answer.
    """
    echo_json(client.get(key, None if body is None else body.read_bytes()))
