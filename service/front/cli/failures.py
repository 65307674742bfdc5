"""`tailroad failures RUN`: how the ego fails."""

from functools import partial
from pathlib import Path

import click

from service.analysis.failures.events import Order
from service.analysis.failures.find import find_failures
from service.analysis.failures.objects import Failures
from service.analysis.failures.rerun import Rerunner
from service.analysis.run.bars import counted
from service.analysis.run.records import record_of
from service.analysis.wording import quantity, significant
from service.evaluation.cores import core_count
from service.front.cli.heads import headed
from service.front.cli.options import echo_found, json_option, workers_option
from service.front.cli.runs import examine_option, method_option, order_option, outcome_option, run_argument
from service.front.cli.tables import dense


@click.command()
@run_argument()
@method_option()
@outcome_option()
@order_option("What ranks first: likeliest x under P0, heaviest in the estimate, or lowest f.")
@click.option("--limit", type=click.IntRange(1, 10_000), default=20, show_default=True,
              help="Dangerous rollouts to list.")  # fmt: skip
@examine_option("run again and group")
@workers_option()
@json_option()
def command(
    run: Path, method: str | None, outcome: str | None, order: Order, limit: int, examine: int, workers: int | None,
    as_json: bool,
) -> None:  # fmt: skip
    """The dangerous rollouts of RUN ranked by likelihood and grouped into failure modes.

    Each is run again, which brings back the same motion to the bit; `tailroad replay RUN RANK` shows one.
    """
    record, _ = record_of(run, method, None, outcome)
    with (
        counted("dangerous rollouts") as watch,
        Rerunner(record.job, workers or core_count()) as rerunner,
    ):
        found = find_failures(run.name, record, rerunner, order, limit, examine, run, watch).failures
    echo_found(found, as_json, partial(_print, run))


def _print(run: Path, found: Failures) -> None:
    console = headed(
        found, f"{_event(found)} in {found.events:,} rollouts, {found.examined:,} of them grouped"
    )
    if found.modes:
        level = f"{found.confidence:.0%} interval"
        table = dense("failure mode", "events", f"share of p\n{level}", f"p\n{level}", "example")
        for mode in found.modes:
            (share_low, share_high), (low, high) = mode.share_ci, mode.ci
            table.add_row(
                mode.mode,
                f"{mode.events:,}",
                f"{mode.share:.1%}\n{share_low:.0%} to {share_high:.0%}",
                f"{significant(mode.p, 2)}\n{significant(low, 2)} to {significant(high, 2)}",
                f"rank {mode.example.rank}",
            )
        console.print(table)
        for mode in found.modes:
            console.print(f"[bold]{mode.mode}[/bold]: {mode.name}.", highlight=False)
            if mode.typical:
                console.print(f"  Typically {mode.typical}.", style="dim", highlight=False)
            if mode.example.story:
                console.print(
                    f"  As in rank {mode.example.rank}: {mode.example.story}.", style="dim", highlight=False
                )
    for cause in found.causes:
        low, high = cause.share_ci
        console.print(
            f"{cause.share:.0%} of p ({low:.0%} to {high:.0%}): {cause.name}; as in rank {cause.rank}: {cause.story}.",
            highlight=False,
        )
    if found.failures:
        unit = f"f, {found.unit}".rstrip(", ")
        table = dense("rank", unit, "failure mode", "other", "at, s", "log\np0(x)", "weight", "share", "row")
        for failure in found.failures:
            table.add_row(
                str(failure.rank),
                significant(failure.f),
                failure.mode,
                failure.other or "-",
                "-" if failure.motion is None else f"{failure.motion.time_s:.1f}",
                f"{failure.log_likelihood:.1f}",
                f"{failure.weight:.3g}",
                f"{failure.share:.1%}",
                str(failure.row),
            )
        console.print(table)
        so = f"--outcome {found.outcome} " if found.outcome else ""
        click.echo(f"See one: tailroad replay {run} 1 {so}--video rank1.mp4")
    for note in found.notes:
        console.print(f"[yellow]{note}[/yellow]")


def _event(found: Failures) -> str:
    return f"ended with {found.outcome}" if found.outcome else f"f <= {quantity(found.gamma, found.unit)}"
