"""`tailroad get KEY`: anything that a service answers, as JSON or as a file."""

from pathlib import Path

import click
import msgspec

from service.errors import InputError, StoreError
from service.front.cli.client_options import client_options
from service.front.cli.options import echo_json
from service.remote.client import Client


@click.command()
@click.argument("key")
@click.option("--body", type=click.Path(exists=True, dir_okay=False, path_type=Path),
              help="File with JSON to send with it.")  # fmt: skip
@click.option(
    "--out", type=click.Path(dir_okay=False, path_type=Path), help="Write the answer to this file as it is."
)
@click.option("--json", "as_json", is_flag=True, help="The answer is printed as JSON in any case.")
@client_options()
def command(key: str, body: Path | None, out: Path | None, as_json: bool, client: Client) -> None:
    """Print what the service answers at KEY, as in jobs/JOB/estimate?gamma=0.14;confidence=0.95.

    `tailroad get about` lists the keys, `tailroad get schemas/NAME` prints the JSON Schema of what they
    answer. Files, as of jobs/JOB/report or jobs/JOB/rollouts/ROW/export?format=mp4, go to --out.
    """
    answer = client.get(key, None if body is None else body.read_bytes())
    if out is None:
        try:
            echo_json(answer)
        except (msgspec.DecodeError, UnicodeError) as error:
            raise InputError(
                f"{key}: the answer is a file of {len(answer):,} bytes; give --out FILE"
            ) from error
        return
    try:
        out.write_bytes(answer)
    except OSError as error:
        raise StoreError(f"cannot write {out}: {error.strerror or error}") from error
    click.echo(out)
