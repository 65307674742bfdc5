"""`tailroad train drivers|drivers-bc|ego-lidar|ego-vision|thresholds|rates|committor`: all but the last three need the
`train` extra (torch)."""

import importlib
import sys

import click

from service.errors import InputError

SCRIPTS = {
    "drivers": "service.training.drivers_gail",
    "drivers-bc": "service.training.drivers",
    "ego-lidar": "service.training.ego_lidar",
    "ego-vision": "service.training.ego_vision",
    "thresholds": "service.training.thresholds",
    "rates": "service.training.rates",
    "committor": "service.training.committor",
}


@click.command(
    context_settings={
        "ignore_unknown_options": True,
        "allow_interspersed_args": False,
        "help_option_names": ["-h", "--help"],
    }
)
@click.argument("what", metavar="WHAT", type=click.Choice(list(SCRIPTS)))
@click.argument("arguments", nargs=-1, type=click.UNPROCESSED)
def command(what: str, arguments: tuple[str, ...]) -> None:
    """Train the drivers or an ego, or measure in the traffic that they make: thresholds and rates of rare events.

    WHAT, in the order in which one rests on the other:

    \b
    drivers-bc  human drivers by behaviour cloning (the baseline)
    drivers     human drivers by model-based adversarial imitation
    ego-lidar   the ego that sees lidar
    thresholds  the gamma at which p is 1e-2, 1e-3, 1e-4 and 1e-5
    rates       an ego's contacts per million km, and which of them it ran into
    ego-vision  the ego that sees camera and lidar
    committor   what the method paths starts from in a scenario

    `tailroad train WHAT --help` lists the options of each.
    """
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
