"""Commands that read a run: which run, which of its jobs."""

from collections.abc import Callable
from pathlib import Path

import click

from service.analysis.failures.events import ORDERS
from service.analysis.failures.examine import EXAMINED


def run_argument(name: str = "run") -> Callable:
    return click.argument(name, type=click.Path(exists=True, file_okay=False, path_type=Path))


def method_option() -> Callable:
    return click.option("--method", help="Whose rollouts, where the run has several methods.  [default: the one "
                        "with most dangerous rollouts]")  # fmt: skip


def order_option(says: str = "The order that ranks count in, as of `tailroad failures`.") -> Callable:
    return click.option(
        "--by", "order", type=click.Choice(ORDERS), default="likelihood", show_default=True, help=says
    )


def examine_option(done_with_them: str) -> Callable:
    return click.option("--examine", type=click.IntRange(1), default=EXAMINED, show_default=True,
                        help=f"Dangerous rollouts at most to {done_with_them}.")  # fmt: skip


def outcome_option() -> Callable:
    return click.option("--outcome", help="The rollouts that ended so (collision, off-road, reversing, finished, "
                        "horizon), whatever their f, instead of those with f <= gamma.")  # fmt: skip
