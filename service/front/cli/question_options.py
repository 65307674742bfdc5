"""Options of a question, whoever answers it: this machine (`tailroad estimate`) or a service (`tailroad submit`)."""

from collections.abc import Callable
from typing import Any

import click
import msgspec

from service.errors import InputError
from service.front.cli.options import all_of, finite, measure_option, noise_mode_option


def scenario_options() -> Callable[[Callable], Callable]:
    """`--measure` and `--noise-mode`, in place of the scenario's."""
    return all_of(measure_option(), noise_mode_option())


def method_options(budget: str) -> Callable[[Callable], Callable]:
    """`--budget`, `--rel-error`, `--confidence` and `--option`, of every method.

    budget: what it counts
    """
    return all_of(
        click.option("--budget", type=click.IntRange(1), default=20_000, show_default=True, help=budget),
        click.option("--rel-error", type=click.FloatRange(0, min_open=True), callback=finite,
                     help="Stop when the interval's relative half-width is this small."),
        click.option("--confidence", type=click.FloatRange(0, 1, min_open=True, max_open=True), default=0.95,
                     show_default=True),
        click.option("--option", "options", multiple=True, metavar="NAME=VALUE",
                     help="Option of the method, as in rho=0.1; once for each."),
    )  # fmt: skip


def option_of(text: str) -> tuple[str, Any]:
    """NAME=VALUE: the value as JSON, or else as text."""
    name, equals, value = text.partition("=")
    if not name or not equals:
        raise InputError(f"--option {text}: give NAME=VALUE, as in rho=0.1")
    try:
        return name, msgspec.json.decode(value.encode())
    except (msgspec.DecodeError, ValueError):
        return name, value
