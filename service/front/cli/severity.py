"""`tailroad severity RUN`: how severe the contacts are."""

from pathlib import Path

import click
from rich.table import Table
from rich.text import Text

from service.analysis.failures.events import Order
from service.analysis.run.bars import counted
from service.analysis.severity.objects import Injury, Likely, Severity
from service.analysis.severity.severe import SPEEDS_MPS
from service.analysis.wording import significant
from service.errors import InputError
from service.front.cli.heads import headed
from service.front.cli.options import echo_found, json_option, workers_option
from service.front.cli.runs import examine_option, method_option, order_option, run_argument
from service.front.cli.tables import whole

SHOWN = 8  # contacts in the table; --json has more


def _masses(given: tuple[str, ...]) -> dict[str, float]:
    found = {}
    for one in given:
        name, _, kg = one.partition("=")
        try:
            found[name] = float(kg)
        except ValueError:
            raise InputError(f"--mass {one}: give VEHICLE=KG, as in env1=12000") from None
    return found


@click.command()
@run_argument()
@method_option()
@click.option("--delta-v", "speeds_mps", type=click.FloatRange(min=0.0), multiple=True, default=SPEEDS_MPS,
              show_default=True, help="Changes of the ego's velocity to give probabilities of, m/s.")  # fmt: skip
@click.option("--mass", "masses", multiple=True, metavar="VEHICLE=KG",
              help="A vehicle's mass, in place of its class's.")  # fmt: skip
@order_option()
@examine_option("run again")
@workers_option()
@json_option()
def command(
    run: Path,
    method: str | None,
    speeds_mps: tuple[float, ...],
    masses: tuple[str, ...],
    order: Order,
    examine: int,
    workers: int | None,
    as_json: bool,
) -> None:
    """How severe are the contacts: change of velocity, risk of serious injury?

    From the dangerous rollouts of RUN, their contacts on record and their weights alone; the severest are run again for
    what led up to them. Where a record has no contacts, a sample of its dangerous rollouts is run again.
    """
    from service.analysis.run.verdicts import severity_of_run

    with counted("dangerous rollouts") as watch:
        found = severity_of_run(run, method, speeds_mps, _masses(masses), order, examine, workers, watch)
    echo_found(found, as_json, _print)


def _print(found: Severity) -> None:
    among = f"{found.examined:,} of {found.events:,} dangerous rollouts"
    console = headed(found, f"{found.contact.events:,} contacts among {among}")
    table = Table("of a rollout", "contacts", whole(f"p, {found.confidence:.0%} interval"))
    table.add_row("contact", *_cells(found.contact))
    for one in found.at_least:
        table.add_row(f"delta-v of the ego at least {one.delta_v_mps:g} m/s", *_cells(one))
    table.add_row("serious injury (MAIS3+) in the ego", *_cells(found.injury))
    table.add_row("serious injury in the other vehicle", *_cells(found.other_injury))
    console.print(table)
    if found.contacts:
        console.print(
            f"Of a contact: {_given(found.injury)} in the ego, {_given(found.other_injury)} in the other.",
            highlight=False,
        )
        worst = Table(
            "rank", "delta-v, m/s", "P(MAIS3+)", "hit at", "other", "relative, m/s", "from, deg", "mode"
        )
        for hit in found.contacts[:SHOWN]:
            worst.add_row(
                str(hit.rank),
                f"{hit.ego.delta_v_mps:.1f}",
                f"{hit.ego.injury:.1%}",
                f"{hit.contact.ego_side}, {hit.contact.ego_part}",
                hit.other or "background",
                f"{hit.contact.speed_mps:.1f}",
                f"{hit.direction_deg:.0f}",
                Text(hit.mode, no_wrap=True),
            )
        console.print(worst)
    for line in found.assumptions:
        console.print(line, style="dim", highlight=False)
    for note in found.notes:
        console.print(f"[yellow]{note}[/yellow]")


def _cells(one: Likely) -> tuple[str, str]:
    low, high = one.ci
    return f"{one.events:,}", f"{significant(one.p, 2)}, {significant(low, 2)} to {significant(high, 2)}"


def _given(injury: Injury) -> str:
    low, high = injury.given_contact_ci
    return f"{injury.given_contact:.1%} ({low:.1%} to {high:.1%})"
