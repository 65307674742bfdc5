"""`tailroad train drivers|drivers-bc|ego-lidar|ego-vision|thresholds`: needs the `train` extra (torch)."""

import importlib
import sys

import click

from service.errors import InputError

SCRIPTS = {
    "drivers": "policies.training.drivers_gail",
    "drivers-bc": "policies.training.drivers",
    "ego-lidar": "policies.training.ego_lidar",
    "ego-vision": "policies.training.ego_vision",
    "thresholds": "policies.training.thresholds",
}


@click.command(context_settings={"ignore_unknown_options": True, "help_option_names": []})
@click.argument("what", type=click.Choice(list(SCRIPTS)))
@click.argument("arguments", nargs=-1, type=click.UNPROCESSED)
def command(what: str, arguments: tuple[str, ...]) -> None:
    """Train the drivers (by adversarial imitation, or by behaviour cloning) or an ego, or find the thresholds of
    rare events in the new traffic; `tailroad train WHAT --help` lists the script's own options."""
    try:
        script = importlib.import_module(SCRIPTS[what])
    except ModuleNotFoundError as error:
        if error.name not in ("torch", "sklearn", "onnx"):
            raise
        raise InputError(
            f"training needs {error.name}; install tailroad with its extra: tailroad[train]"
        ) from error
    from policies.data.scenes import DataError

    sys.argv = [f"tailroad train {what}", *arguments]
    try:
        script.main()
    except DataError as error:
        raise InputError(str(error)) from error
