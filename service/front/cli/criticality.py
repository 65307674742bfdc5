"""`tailroad criticality RUN`: dangerous rollouts by the measures of the field."""

from pathlib import Path

import click
from rich.table import Table

from service.analysis.criticality.objects import Criticality
from service.analysis.failures.events import Order
from service.analysis.wording import percent, significant
from service.front.cli.heads import headed
from service.front.cli.options import echo_found, json_option, workers_option
from service.front.cli.runs import method_option, order_option, run_argument
from service.front.cli.tables import dense


@click.command()
@run_argument()
@method_option()
@order_option()
@click.option(
    "--limit", type=click.IntRange(1, 500), default=20, show_default=True, help="Rollouts to look at."
)
@workers_option()
@json_option()
def command(
    run: Path, method: str | None, order: Order, limit: int, workers: int | None, as_json: bool
) -> None:
    """How critical are the dangerous rollouts: TTC, WTTC, TTB, TTR, BTN, TET, TIT?

    Each of the first rollouts of RUN in the order asked for is run again; its measures are towards the vehicle that the
    conflict is with.
    """
    from service.analysis.run.verdicts import criticality_of_run

    found = criticality_of_run(run, method, order, limit, workers)
    echo_found(found, as_json, _print)


def _print(found: Criticality) -> None:
    counts = f"{len(found.rollouts):,} of {found.events:,} dangerous rollouts"
    console = headed(found, counts, highlight=False)
    table: Table = dense("rank", "of p", "other", "TTC", "WTTC", "TTB", "TTR", "too late to\nbrake, react", "BTN",
                         "TET", "TIT")  # fmt: skip
    for one in found.rollouts:
        late = f"{_s(one.too_late_to_brake_s)}, {_s(one.too_late_to_react_s)}"
        measures = (one.ttc_s, one.wttc_s, one.ttb_s, one.ttr_s)
        exposed = (one.btn, one.tet_s, one.tit_s2)
        who = one.error or one.other or "background"
        table.add_row(str(one.rank), percent(one.share), who, *map(_s, measures), late, *map(_s, exposed))
    console.print(table)
    console.print(f"Seconds; TIT in s^2. TET and TIT: TTC at most {found.tau_s:g} s. Too late: at that time.",
                  highlight=False)  # fmt: skip
    for line in found.assumptions:
        console.print(line, style="dim", highlight=False)


def _s(value: float | None) -> str:
    return "-" if value is None else significant(value, 2)
