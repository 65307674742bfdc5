"""`--ego` and what goes with an ego outside tailroad: these options are this process's own configuration.

They are kept as environment variables (service.world.egos.settings), which worker processes take over.
"""

import os
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import click

from policies.egos import ego_names
from policies.egos.onnx_file import PREFIX as ONNX
from service.front.cli.options import all_of
from service.world.egos.here import permit
from service.world.egos.open import check_ego
from service.world.egos.settings import EgoSettings


def ego_option(default: str = "lidar", multiple: bool = False) -> Callable:
    """`--ego`, `--ego-address`, `--ego-deadline` and `--ego-patience`; the command is given `ego` alone.

    multiple: `--ego` may come several times; `ego` is then a tuple, and there is no default.
    """
    return all_of(
        click.option(
            "--ego",
            default=None if multiple else default,
            show_default=not multiple,
            multiple=multiple,
            callback=_permit_each if multiple else _permit,
            help=f"The driving policy under test: {', '.join(ego_names())}, sumo:MODEL for one of SUMO's "
            "car-following models (sumo:Krauss), zenoh:NAME for a service on the network, MODULE:CLASS for a class of "
            "your own, or onnx:FILE for a network of your own.",
        ),
        _kept("--ego-address", str, "address", "Where zenoh:NAME is: the service itself or a Zenoh router.  "
              "[default: tcp/127.0.0.1:7447]"),
        _kept("--ego-deadline", float, "deadline_s", "Seconds that zenoh:NAME may take for an answer.  [default: 1]"),
        _kept("--ego-patience", float, "patience_s", "Seconds to wait for zenoh:NAME where it is not there.  "
              "[default: 10]"),
    )  # fmt: skip


def _kept(name: str, kind: type, field: str, says: str) -> Callable:
    """An option that is kept in the environment, as that field of EgoSettings, and not given to the command."""

    def keep(ctx: click.Context, param: click.Parameter, value: Any) -> None:
        if value is not None:
            os.environ.update(replace(EgoSettings.from_environment(), **{field: value}).as_environment())

    return click.option(name, type=kind, expose_value=False, is_eager=True, callback=keep, help=says)


def _permit_each(ctx: click.Context, param: click.Parameter, egos: tuple[str, ...]) -> tuple[str, ...]:
    return tuple(_permit(ctx, param, ego) for ego in egos)


def _permit(ctx: click.Context, param: click.Parameter, ego: str) -> str:
    """Whoever types MODULE:CLASS on a command line may import it there, from the current folder too."""
    if ego.startswith(ONNX):
        ego = f"{ONNX}{Path(ego.removeprefix(ONNX)).resolve()}"
    permit(ego)
    if ":" in ego and os.getcwd() not in sys.path:
        sys.path.append(os.getcwd())
    check_ego(ego)
    return ego
