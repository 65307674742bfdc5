"""Commands that read a run: which run, which of its jobs."""

from collections.abc import Callable
from pathlib import Path

import click


def run_argument(name: str = "run") -> Callable:
    return click.argument(name, type=click.Path(exists=True, file_okay=False, path_type=Path))


def method_option() -> Callable:
    return click.option("--method", help="Whose rollouts, where the run has several methods.  [default: the one "
                        "with most dangerous rollouts]")  # fmt: skip


def outcome_option() -> Callable:
    return click.option("--outcome", help="The rollouts that ended so (collision, off-road, reversing, finished, "
                        "horizon), whatever their f, instead of those with f <= gamma.")  # fmt: skip
