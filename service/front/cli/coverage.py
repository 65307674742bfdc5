"""`tailroad coverage RUN`: which cells of the operational design domain the rollouts lie in."""

from pathlib import Path

import click
from rich.text import Text

from service.analysis.coverage.objects import Cell, Coverage
from service.analysis.wording import percent, significant
from service.front.cli.heads import headed
from service.front.cli.options import echo_found, json_option
from service.front.cli.runs import method_option, run_argument
from service.front.cli.tables import dense

PAIRS = 5  # of cells never seen together that are listed


@click.command()
@run_argument()
@method_option()
@click.option("--domain", type=click.Path(exists=True, dir_okay=False, path_type=Path),
              help="A file (TOML) that declares the domain: of each attribute the cells inside.")  # fmt: skip
@click.option("--page", type=click.Path(dir_okay=False, path_type=Path), help="Write an HTML page, too.")
@json_option()
def command(run: Path, method: str | None, domain: Path | None, page: Path | None, as_json: bool) -> None:
    """What of the operational design domain was tested: road, weather, light, density, speeds, vehicles?

    Of each cell: its mass under P0, its share of the rollouts and of p; and cells never seen. From the draws alone;
    nothing is run.
    """
    from service.analysis.coverage.cover import coverage_of
    from service.analysis.coverage.domain import load_domain
    from service.analysis.report.domain import domain_page
    from service.analysis.run.records import record_of, write_file

    declared = None if domain is None else load_domain(domain)
    found = coverage_of(run.name, record_of(run, method)[0], declared)
    if page is not None:
        write_file(page, ".html", lambda: domain_page(found).encode())
    echo_found(found, as_json, _print)


def _print(found: Coverage) -> None:
    counts = f"{found.looked_at:,} rollouts and {found.examined:,} of {found.events:,} dangerous ones"
    console = headed(found, counts, highlight=False)
    table = dense(
        "", "of P0", "of rollouts", "of p", f"{found.confidence:.0%} interval", "times as\ndangerous"
    )
    for one in found.attributes:
        shown = [cell for cell in one.cells if cell.mass or cell.rollouts or cell.events]
        table.add_row(Text(one.attribute, style="bold"))
        for cell in shown:
            table.add_row(Text(f"  {_name(cell)}"), *_shares(cell))
    console.print(table)
    for one in found.attributes:
        if one.never_drawn:
            unit = f", {one.unit}" if one.unit else ""
            console.print(
                f"{one.attribute} ({one.heading}{unit}): P0 does not draw {'; '.join(one.never_drawn)}.",
                style="dim",
                highlight=False,
            )
        if one.never_seen:
            console.print(
                f"[yellow]{one.attribute}: never seen: {'; '.join(one.never_seen)}.[/yellow]", highlight=False
            )
    if found.pairs_seen is not None:
        console.print(f"Of {found.pairs:,} cells of two attributes that P0 draws, {found.pairs_seen:,} hold a rollout.",
                      highlight=False)  # fmt: skip
        for pair in found.pairs_never_seen[:PAIRS]:
            (a, b), (one_cell, other) = pair.attributes, pair.cells
            console.print(
                f"  never seen: {a} {one_cell} with {b} {other} ({percent(pair.mass)} of P0)", highlight=False
            )
    for line in found.missing:
        console.print(
            f"[yellow]Of the domain {found.domain!r} no rollout lies in {line}.[/yellow]", highlight=False
        )
    for note in found.notes:
        console.print(f"[yellow]{note}[/yellow]", highlight=False)


def _name(cell: Cell) -> str:
    return cell.cell + (" (outside)" if cell.inside is False else "")


def _shares(cell: Cell) -> tuple[str, str, str, str, str]:
    seen = (
        "-"
        if cell.rollouts_share is None
        else percent(cell.rollouts_share)
        if cell.rollouts
        else "never seen"
    )
    if cell.share is None or cell.share_ci is None:
        return percent(cell.mass), seen, "-", "-", "-"
    low, high = cell.share_ci
    times = "-" if cell.times is None else significant(cell.times, 2)
    return percent(cell.mass), seen, percent(cell.share), f"{percent(low)} to {percent(high)}", times
