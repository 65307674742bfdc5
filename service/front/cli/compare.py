"""`tailroad compare`: egos on the same draws, or runs."""

from pathlib import Path
from typing import Any

import click
from rich.console import Console
from rich.table import Table

from service.analysis.comparison.objects import Comparison, ModeChange, Pair
from service.analysis.failures.examine import EXAMINED
from service.analysis.run import Interrupted, compare
from service.analysis.run.bars import Shown, progress_bar, stderr
from service.analysis.run.question import BUDGET, SEED
from service.analysis.wording import quantity, significant
from service.evaluation.cores import core_count
from service.evaluation.options import METHODS
from service.front.cli.ego_options import ego_option
from service.front.cli.main import INTERRUPTED
from service.front.cli.options import FOLDER, echo_json, finite, json_option, seed_option, workers_option
from service.front.cli.tables import folded, side_by_side, whole


@click.command()
@click.argument("what", nargs=-1, required=True, metavar="SCENARIO | RUN...")
@ego_option(multiple=True)
@click.option("--gamma", type=float, callback=finite, help="The event is f <= GAMMA, in the measure's unit.  "
              "[RUN...: default: their own]")  # fmt: skip
@click.option("--method", type=click.Choice(METHODS), help="SCENARIO: how p is estimated.  [default: naive]  "
              "RUN...: which of their jobs.  [default: one that all have]")  # fmt: skip
@click.option("--budget", type=click.IntRange(1),
              help=f"SCENARIO: rollouts of each ego at most.  [default: {BUDGET}]")  # fmt: skip
@seed_option(None, f"SCENARIO: same seed, same bits.  [default: {SEED}]")
@click.option("--examine", type=click.IntRange(0), default=EXAMINED, show_default=True,
              help="Dangerous rollouts of each at most to run again and group into failure modes.")  # fmt: skip
@click.option("--out", type=FOLDER, help="SCENARIO: folder for the run "
              "directories; what it holds already is continued.  [default: runs/compare-SCENARIO-TIME]")  # fmt: skip
@click.option("--html", type=click.Path(dir_okay=False, path_type=Path), help="Write a page to this file.")
@workers_option()
@json_option()
def command(
    what: tuple[str, ...],
    ego: tuple[str, ...],
    html: Path | None,
    workers: int | None,
    as_json: bool,
    **asked: Any,
) -> None:
    """Compare egos on SCENARIO (--ego A --ego B ...), run on the same draws, or finished runs.

    The same draws are those of naive Monte Carlo, which is therefore the method here, however rare the event; with
    another --method each ego has draws of its own.

    Each against each that stands before it: difference and ratio of p with intervals, p(gamma) of all, and which ways
    to fail came and went.
    """
    runs = len(what) > 1 or (Path(what[0]) / "run.json").exists()
    count = workers or core_count()
    with progress_bar() as bar:
        task = bar.add_task("dangerous rollouts", total=None, note="", visible=False)
        try:
            compared = compare(
                [Path(name) for name in what] if runs else what[0],
                ego,
                workers=count,
                progress=Shown(bar, count, lambda told: told.job.ego),
                watch=lambda done, total: bar.update(task, completed=done, total=total, visible=True),
                **asked,
            )
        except Interrupted as stopped:
            stderr.print(
                f"\nInterrupted; what was run is kept. Continue with the same command and --out {stopped.path}"
            )
            raise SystemExit(INTERRUPTED) from None
    found = compared.comparison
    if html is not None:
        compared.report(html)
    if as_json:
        echo_json(found)
        return
    _print(found)
    if html is not None:
        click.echo(f"Page: {html}")


HOW = {"normal": "normal", "paired counts": "exact, of the pairs", "bounds": "bounds of both intervals"}


def _print(found: Comparison) -> None:
    console = Console()
    level = f"{found.confidence:.0%}"
    console.print(f"\np = P0(f <= {quantity(found.gamma, found.unit)})")
    for sides in side_by_side(found.sides, 2):
        table = Table("", *[whole(folded(side.name)) for side in sides])
        rows = [
            ("scenario", [folded(s.scenario) for s in sides]),
            ("ego", [folded(s.ego) for s in sides]),
            ("method, rollouts", [f"{s.method}, {s.rollouts:,}" for s in sides]),
            ("p", [significant(s.p) for s in sides]),
            (f"{level} interval", [_span(s.ci) for s in sides]),
            ("dangerous rollouts (effective)", [f"{s.events:,} ({significant(s.ess)})" for s in sides]),
        ]
        for label, values in rows:
            table.add_row(label, *values)
        console.print(table)
    for pair in found.pairs:
        _print_pair(console, found, pair, level)
    for note in found.notes:
        console.print(f"[yellow]{note}[/yellow]")


def _print_pair(console: Console, found: Comparison, pair: Pair, level: str) -> None:
    a, b, d = found.sides[pair.a], found.sides[pair.b], pair.difference
    console.print(f"\n[bold]{b.name}[/bold] against [bold]{a.name}[/bold]", highlight=False)
    table = Table("", "", whole(f"{level} interval"), "how")
    table.add_row("difference of p", significant(d.difference), _span(d.difference_ci), HOW[d.how])
    table.add_row(
        "ratio of p", significant(d.ratio), _span(d.ratio_ci), "same draws" if d.paired else "own draws"
    )
    console.print(table)
    if pair.draws is not None:
        p = pair.draws
        console.print(
            f"Of the same draws, {p.both:,} are dangerous to both, {p.only_a:,} to {a.name} only, "
            f"{p.only_b:,} to {b.name} only.", highlight=False,
        )  # fmt: skip
    if pair.modes:
        table = Table(
            whole("failure mode"),
            "p of the latter\nof the former",
            whole(f"difference\n{level} interval"),
            "change",
        )
        for mode in pair.modes:
            table.add_row(
                mode.mode,
                f"{significant(mode.a.p, 2)}\n{significant(mode.b.p, 2)}",
                f"{significant(mode.difference.difference, 2)}\n{_span(mode.difference.difference_ci)}",
                _change(mode),
            )
        console.print(table)
    console.print(pair.summary, highlight=False)


def _change(mode: ModeChange) -> str:
    return "not clear" if mode.change == "unclear" else mode.change


def _span(ci: tuple[float, float | None]) -> str:
    low, high = ci
    return f"{significant(low, 2)} to {'∞' if high is None else significant(high, 2)}"
