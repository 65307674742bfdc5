"""`tailroad prevent RUN`: what part of p a competent driver would have prevented."""

import math
from functools import partial
from pathlib import Path

import click
from rich.table import Table
from rich.text import Text

from service.analysis.failures.events import Order
from service.analysis.prevention.objects import Part, Prevention
from service.analysis.prevention.onset import TTC_S
from service.analysis.prevention.prevent import DEFAULT
from service.analysis.run.bars import counted
from service.analysis.wording import quantity, significant
from service.front.cli.heads import headed
from service.front.cli.options import echo_found, json_option, require_folder, workers_option
from service.front.cli.runs import examine_option, method_option, order_option, run_argument
from service.front.cli.tables import whole

FROM_THE_START = "start"


def _seconds(ctx: click.Context, param: click.Parameter, value: str) -> float:
    if value == FROM_THE_START:
        return math.inf
    try:
        seconds = float(value)
    except ValueError:
        seconds = math.nan
    if not 0.0 < seconds < math.inf:
        raise click.BadParameter(f"{value}: give seconds above 0, or {FROM_THE_START!r}")
    return seconds


@click.command()
@run_argument()
@method_option()
@click.option("--reference", "references", multiple=True, default=DEFAULT, show_default=True,
              help="Who drives in the ego's place, once for each: r157-cc, r157-cc-aeb, r157-5.2.5.2, fsm, rss, or any "
              "ego.")  # fmt: skip
@click.option("--onset-ttc", "onset_ttc_s", default=str(TTC_S), show_default=True, callback=_seconds,
              help="Seconds to collision at which a conflict begins; 'start': with the rollout.")  # fmt: skip
@order_option()
@examine_option("drive again")
@click.option("--video", type=click.Path(dir_okay=False, path_type=Path),
              help="Instead: a film (.mp4) of one rollout as it was and with the first reference driver.")  # fmt: skip
@click.option("--rank", type=click.IntRange(1), default=1, show_default=True,
              help="With --video: which dangerous rollout.")  # fmt: skip
@workers_option()
@json_option()
def command(
    run: Path,
    method: str | None,
    references: tuple[str, ...],
    onset_ttc_s: float,
    order: Order,
    examine: int,
    video: Path | None,
    rank: int,
    workers: int | None,
    as_json: bool,
) -> None:
    """What part of p would a competent driver have prevented?

    Each dangerous rollout of RUN is driven again with the same draw, the ego replaced from the onset of the conflict
    on. What was found is kept in RUN; `tailroad report RUN` shows it.
    """
    from service.analysis.run.verdicts import prevention_of

    if video is not None:
        _film(run, method, references[0], onset_ttc_s, order, rank, video)
        return
    with counted("conflicts") as watch:
        found = prevention_of(run, method, references, order, examine, onset_ttc_s, workers, watch)
    echo_found(found, as_json, partial(_print, run))


def _film(
    run: Path, method: str | None, reference: str, onset_ttc_s: float, order: Order, rank: int, video: Path
) -> None:
    """Write the film of one rollout, and say what it came to."""
    from service.analysis.run.verdicts import film_of

    require_folder(video, "--video")
    before, after, onset_s = film_of(run, rank, video, method, reference, order, onset_ttc_s)
    click.echo(
        f"f = {significant(before.rollout.f)} ({before.rollout.outcome}); with {reference} from {onset_s:.1f} s on "
        f"{significant(after.rollout.f)} ({after.rollout.outcome})\n{video}"
    )


def _print(run: Path, found: Prevention) -> None:
    event = f"f <= {quantity(found.gamma, found.unit)}"
    console = headed(found, f"{event} in {found.events:,} rollouts, {found.examined:,} driven again")
    if found.examined:
        console.print(_summary(found))
        console.print(_modes(found))
    for note in found.notes:
        console.print(f"[yellow]{note}[/yellow]")


def _summary(found: Prevention) -> Table:
    level = f"{found.confidence:.0%} interval"
    table = Table(
        whole("reference driver"),
        whole(f"preventable share of p\n{level}"),
        whole(f"p preventable\n{level}"),
        whole(f"p unpreventable\n{level}"),
    )
    for one in found.references:
        table.add_row(
            Text(one.reference, no_wrap=True),
            _share(one.preventable.share, one.preventable.share_ci),
            _p(one.preventable),
            _p(one.unpreventable),
        )
    return table


def _modes(found: Prevention) -> Table:
    """Each mode with its preventable share by each reference driver."""
    table = Table(
        whole("preventable share\nof the mode"), "events", *(whole(r.reference) for r in found.references)
    )
    for row in zip(*(reference.modes for reference in found.references), strict=True):
        table.add_row(
            Text(row[0].mode, no_wrap=True),
            f"{row[0].events:,}",
            *(_share(mode.share, mode.share_ci) for mode in row),
        )
    return table


def _share(share: float, ci: tuple[float, float]) -> str:
    return f"{share:.0%}\n{ci[0]:.0%} to {ci[1]:.0%}"


def _p(part: Part) -> str:
    low, high = part.ci
    return f"{significant(part.p, 2)}\n{significant(low, 2)} to {significant(high, 2)}"
