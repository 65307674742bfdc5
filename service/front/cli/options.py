"""Options that several commands share."""

import functools
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import click
import msgspec

from service.errors import InputError
from service.evaluation.failed_share import MAX_FAILED
from service.world.scenario.measures import MEASURES

MAX_SEED = 2**63 - 1
Found = TypeVar("Found", bound=msgspec.Struct)
FOLDER = click.Path(file_okay=False, path_type=Path)


def all_of(*options: Callable) -> Callable[[Callable], Callable]:
    """Several options as one decorator, in this order."""
    return lambda command: functools.reduce(lambda made, option: option(made), reversed(options), command)


def seed_option(default: int | None = 1, text: str = "Same seed, same bits.") -> Callable:
    return click.option(
        "--seed",
        type=click.IntRange(0, MAX_SEED),
        default=default,
        show_default=default is not None,
        help=text,
    )


def measure_option() -> Callable:
    return click.option(
        "--measure",
        help=f"The safety measure, in place of the scenario's: {', '.join(MEASURES)}; a formula as in "
        "'stl: always(ttc_s >= 1.0)'.",
    )


NOISE_MODES = click.Choice(("drawn", "frozen", "searched"))


def noise_mode_option() -> Callable[[Callable], Callable]:
    """`--noise-mode`, and its old name `--noise`; the command gets `noise_mode`."""
    given = click.option(
        "--noise-mode",
        type=NOISE_MODES,
        help="The drivers' action noise, in place of the scenario's: a stream for each rollout, one for all, or a part "
        "of X that the method may move (for splitting).",
    )

    def decorate(command: Callable) -> Callable:
        return given(renamed_option("--noise", "--noise-mode", NOISE_MODES)(command))

    return decorate


def renamed_option(old: str, new: str, kind: click.ParamType) -> Callable[[Callable], Callable]:
    """An option's old name: hidden, with a line of notice where it is given; what it says counts for the new one."""
    hidden, name = (option.lstrip("-").replace("-", "_") for option in (old, new))

    def decorate(command: Callable) -> Callable:
        @functools.wraps(command)
        def renamed(*args: Any, **values: Any) -> Any:
            given = values.pop(hidden)
            if given is not None:
                if values[name] is not None:
                    raise InputError(f"{old} is the old name of {new}; give one of them")
                click.echo(f"{old} is called {new} now; the old name still works", err=True)
                values[name] = given
            return command(*args, **values)

        return click.option(old, type=kind, hidden=True)(renamed)

    return decorate


def in_sumo_option() -> Callable:
    return click.option(
        "--in-sumo",
        type=click.Choice(("some", "all")),
        default="some",
        show_default=True,
        help="Rollouts that SUMO drives: the events and one in 100 of the others, which must have the bits of the "
        "compiled ones (of frequent events a share); or all.",
    )


def max_failed_option() -> Callable:
    return click.option("--max-failed", type=click.FloatRange(0, 1), callback=finite, default=MAX_FAILED,
                        show_default=True, help="Stop when more than this share of the rollouts fails; 0: at the "
                        "first, 1: never.")  # fmt: skip


def out_option(default: str, holds: str) -> Callable:
    """`--out` of a command that goes on from what it has kept there. holds: what that is."""
    return click.option("--out", type=FOLDER, default=Path(default), show_default=True,
                        help=f"{holds}; the same command goes on from there.")  # fmt: skip


def pages_option(default: str) -> Callable:
    return click.option("--pages", type=FOLDER, help=f"Where the page is written.  [default: {default}]")


def json_option() -> Callable:
    return click.option("--json", "as_json", is_flag=True, help="Print one JSON object instead of a table.")


def echo_json(body: msgspec.Struct | bytes) -> None:
    """Print what was found, or the JSON that a service answered, indented."""
    data = body if isinstance(body, bytes) else msgspec.json.encode(body)
    click.echo(msgspec.json.format(data, indent=2).decode())


def echo_found(found: Found, as_json: bool, in_words: Callable[[Found], None]) -> None:
    """Print what was found, as JSON or in words."""
    if as_json:
        echo_json(found)
    else:
        in_words(found)


def connect_option(says: str, default: tuple[str, ...] = ()) -> Callable:
    return click.option(
        "--connect",
        multiple=True,
        default=default,
        show_default=bool(default),
        help=f"{says}; once for each.",
    )


def finite(ctx: click.Context, param: click.Parameter, value: Any) -> Any:
    """A click callback that refuses nan and inf, which click takes for floats."""
    if value is not None and not abs(value) < float("inf"):
        raise click.BadParameter(f"{value} is not a finite number")
    return value


def workers_option() -> Callable:
    return click.option(
        "--workers",
        type=click.IntRange(1, 1024),
        default=None,
        help="Local worker processes.  [default: one for each core]",
    )


def zenoh_config_option(says: str = "Zenoh configuration file, for TLS and passwords.") -> Callable:
    return click.option("--zenoh-config", type=click.Path(exists=True, dir_okay=False), help=says)


def require_folder(path: Any, what: str) -> None:
    """InputError when the folder that `path` shall be written to does not exist."""
    if path is not None and not path.resolve().parent.is_dir():
        raise InputError(f"{what} {path}: the folder {path.resolve().parent} does not exist; make it first")
