"""`tailroad accept CASE`: is the fleet safe enough?"""

import sys
from pathlib import Path

import click
from rich.console import Console
from rich.table import Table
from rich.text import Text

from service.analysis.acceptance.objects import Acceptance, Judged
from service.analysis.wording import significant
from service.front.cli.options import echo_found, json_option, workers_option
from service.front.cli.tables import whole

EXIT = {"met": 0, "not met": 1, "undecided": 4}  # as of `tailroad batch`
COLOURS = {"met": "green", "not met": "red", "undecided": "yellow"}


@click.command()
@click.argument("case", type=click.Path(exists=True, dir_okay=False, path_type=Path))
@click.option("--fail-unless", type=click.Choice(("met",)),
              help="For pipelines: exit code 1 where a claim is not met, 4 where one is undecided.")  # fmt: skip
@workers_option()
@json_option()
def command(case: Path, fail_unless: str | None, workers: int | None, as_json: bool) -> None:
    """Rates of a whole case against their targets, with a joint interval, from the runs that CASE (a TOML file) names.

    A claim is met, not met or undecided; where undecided, what it would take to decide.
    """
    from service.analysis.run.acceptance import accept_case

    found = accept_case(case, workers)
    echo_found(found, as_json, _print)
    if fail_unless is not None:
        sys.exit(EXIT[found.verdict])


def _print(found: Acceptance) -> None:
    console = Console()
    colour = COLOURS[found.verdict]
    console.print(f"\n{found.name}: [bold {colour}]{found.verdict}[/]")
    for claim in found.claims:
        console.print(f"\n[bold]{claim.claim}[/bold]: [{COLOURS[claim.verdict]}]{claim.verdict}[/]; {claim.why}.",
                      highlight=False)  # fmt: skip
        console.print(_terms(found, claim))
        console.print(_value(found, claim), highlight=False)
        if claim.needed is not None:
            console.print(f"To decide: {claim.needed.says}.", highlight=False)


def _value(found: Acceptance, claim: Judged) -> str:
    what = "times the human rate" if claim.of_human else f"per {found.unit}"
    value = "unknown" if claim.value is None else significant(claim.value)
    said = f"{claim.measure}: {value} {what}, {found.confidence:.0%} interval {_range(*claim.ci)}"
    return said + (f". People: {claim.human}" if claim.human else "")


def _range(low: float, high: float | None) -> str:
    return f"{significant(low)} to {'∞' if high is None else significant(high)}"


def _terms(found: Acceptance, claim: Judged) -> Table:
    table = Table(
        "scenario",
        whole(f"p\n{found.confidence:.0%} interval"),
        whole(f"rollouts per\n{found.unit}"),
        whole(f"rate per\n{found.unit}"),
        whole("rollouts"),
    )
    for term in claim.terms:
        table.add_row(
            Text(term.scenario, no_wrap=True),
            f"{significant(term.p)}\n{_range(*term.ci)}",
            f"{significant(term.exposure)}\n{_range(*term.exposure_ci)}",
            significant(term.rate),
            "-" if term.rollouts is None else f"{term.rollouts:,}",
        )
    return table
