"""`tailroad drivers card`"""

import json
from contextlib import nullcontext
from pathlib import Path

import click

from service.errors import InputError
from service.front.cli.options import json_option, seed_option
from service.front.cli.progress import stderr


@click.group()
def command() -> None:
    """The human-driver model."""


@command.command()
@click.option("--weights", default="drivers-gail", show_default=True,
              help="Shipped weights, or the path of a .safetensors file.")  # fmt: skip
@click.option("--data", required=True, type=click.Path(path_type=Path),
              help="Folder of the data pack, or of tables that 'tailroad data import' wrote.")  # fmt: skip
@click.option("--out", default=Path("."), show_default=True, type=click.Path(file_okay=False, path_type=Path),
              help="Folder for NAME-realism.html and NAME-realism.json.")  # fmt: skip
@click.option("--samples", type=click.IntRange(1, 100), default=2, show_default=True,
              help="Rollouts of each recorded window.")  # fmt: skip
@click.option("--krauss/--no-krauss", default=True, show_default=True,
              help="Also measure SUMO's own driver, which takes minutes.")  # fmt: skip
@seed_option()
@json_option()
def card(weights: str, data: Path, out: Path, samples: int, krauss: bool, seed: int, as_json: bool) -> None:
    """Measure how like people the drivers drive, beside other models, and write the realism card."""
    from policies.data.scenes import DataError
    from service.studies.realism import card as making

    settings = making.Settings(weights, data, seed, samples, krauss)
    try:
        with stderr.status("reading recordings") if stderr.is_terminal else nullcontext() as status:
            facts = making.make(settings, lambda text: status.update(text) if status is not None else None)
    except DataError as error:
        raise InputError(str(error)) from error
    try:
        written = making.write(facts, out)
    except OSError as error:
        raise InputError(f"{out}: cannot be written ({error})") from error
    if as_json:
        click.echo(json.dumps(facts, indent=1))
        return
    for row in facts["targets"]["rows"]:
        reached = row["reached"]["twenty"]
        click.echo(
            f"{row['label']}: {reached['value']:g} (target {row['target']:g}): "
            f"{'met' if reached['met'] else 'not met'}"
        )
    for path in written:
        click.echo(path)
