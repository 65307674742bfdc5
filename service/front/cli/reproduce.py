"""`tailroad reproduce`: the paper's experiments, run again."""

import time
from contextlib import nullcontext
from pathlib import Path

import click
from rich.progress import Progress, TaskID

from service.analysis.run.bars import progress_bar, stderr
from service.errors import InputError
from service.evaluation.cores import core_count
from service.front.cli.main import INTERRUPTED
from service.front.cli.options import (
    FOLDER,
    connect_option,
    out_option,
    pages_option,
    seed_option,
    workers_option,
    zenoh_config_option,
)
from service.studies.reproduce.black_box import black_box
from service.studies.reproduce.local import Watch, carry_out
from service.studies.reproduce.page import Page, page_of, page_of_several, write_page
from service.studies.reproduce.peers.page import peers_page
from service.studies.reproduce.plans import BLACK_BOX, PLANS, Plan, plans_of
from service.studies.reproduce.qualitative import qualitative_page
from service.studies.reproduce.scale_page import scale_page
from service.studies.reproduce.sizes import SCALES
from service.studies.reproduce.verdict import verdict_page

WORLDS_TITLE = "Other worlds: the whole 2 km, another road, another's ego, a black box"
FLEET = tuple(name for name in PLANS if name != "worlds")  # its black box is on this machine
REPORT_EVERY_S = 60.0  # where standard error is no terminal


@click.command()
@click.argument(
    "name", metavar="NAME", type=click.Choice((*PLANS, "qualitative", "verdict", "scale", "peers"))
)
@click.option("--scale", type=click.Choice(SCALES), default="small", show_default=True,
              help="smoke: seconds; small: minutes; medium: an hour; large: hours; paper: the sizes of the "
              "paper.")  # fmt: skip
@out_option("runs/reproduce", "Holds the run directories")
@pages_option("OUT/pages")
@click.option("--truths", type=FOLDER, help="Where ground truths accumulate.  "
              "[default: OUT/truths]")  # fmt: skip
@click.option("--sumo", is_flag=True, help="Run every rollout in SUMO. Without it SUMO is left out where it can be, "
              "several times faster; one rollout in a hundred is run in both and compared bit for bit.")  # fmt: skip
@connect_option("Run experiments that are runs alone on the fleet at this Zenoh endpoint (all of it in SUMO) instead "
                "of local workers")  # fmt: skip
@zenoh_config_option()
@workers_option()
@seed_option()
def command(
    name: str,
    scale: str,
    out: Path,
    pages: Path | None,
    truths: Path | None,
    sumo: bool,
    connect: tuple[str, ...],
    zenoh_config: str | None,
    workers: int | None,
    seed: int,
) -> None:
    """Run the experiment NAME of the paper again and write its page.

    \b
    truth        the lidar ego by naive Monte Carlo alone
    table1       the lidar ego: ground truth, Algorithm 1 with rho = 0.01
    fig2         the same for several rho
    table2, fig3 the vision ego, with the settings tuned on the lidar ego
    beyond       our estimators at equal total cost, down to p = 1e-6
    qualitative  what was learned, how the ego fails, films
    worlds       the whole 2 km, another road, another's ego, a black box
    verdict      five egos: contacts, severity, what people would have prevented
    scale        local cores measured, larger fleets played
    peers        other simulators, installed and timed beside ours

    What is finished is not run again: after Ctrl-C, a crash or a kill the same command goes on (scale and peers begin
    anew).
    """
    workers = workers or core_count()
    pages = pages or out / "pages"
    command_line = _command_line(name, scale, sumo, seed)
    ctx = click.get_current_context()
    try:
        if connect and name not in FLEET:
            raise InputError(f"--connect does not go with {name}; what runs on a fleet: {', '.join(FLEET)}")
        if connect:
            (plan,) = plans_of(name, scale, seed)
            page = _on_fleet(plan, connect, zenoh_config, command_line)
        elif name in PLANS:
            plans = plans_of(name, scale, seed)
            page = _carried_out(plans, out, truths or out / "truths", workers, sumo, command_line)
        elif name == "qualitative":
            with progress_bar() as bar:
                watch = _watch(bar, bar.add_task(name, total=None, note=""), 0)
                page = qualitative_page(scale, seed, out, pages, workers, sumo, watch, command_line)
        elif name == "verdict":
            page = verdict_page(scale, seed, out, workers, lambda what: stderr.print(what), command_line)
        elif name == "peers":
            page = peers_page(scale, out, command_line, lambda what: stderr.print(what))
        else:
            page = scale_page(scale, workers, command_line, lambda what: stderr.print(what))
    except KeyboardInterrupt:
        stderr.print("\nInterrupted; what was run is kept. The same command goes on.")
        ctx.exit(INTERRUPTED)
    click.echo(f"Page: {write_page(page, pages)}")


def _carried_out(
    plans: tuple[Plan, ...], out: Path, truths: Path, workers: int, sumo: bool, command_line: str
) -> Page:
    total = sum(plan.rollouts for plan in plans)
    serving = any(plan.truth.ego == f"zenoh:{BLACK_BOX}" for plan in plans)
    with progress_bar() as bar, black_box(BLACK_BOX) if serving else nullcontext():
        watch = _watch(bar, bar.add_task(plans[0].name, total=total, note=""), total)
        outcomes = [carry_out(plan, out, truths, workers, sumo, watch) for plan in plans]
    return (
        page_of(outcomes[0], command_line)
        if len(plans) == 1
        else page_of_several(WORLDS_TITLE, outcomes, command_line)
    )


def _on_fleet(plan: Plan, connect: tuple[str, ...], zenoh_config: str | None, command_line: str) -> Page:
    from service.remote.client import Client  # Zenoh takes a moment to import
    from service.studies.reproduce.fleet import carry_out_on

    with Client(list(connect), zenoh_config) as client, progress_bar() as bar:
        watch = _watch(bar, bar.add_task(plan.name, total=plan.rollouts, note=""), plan.rollouts)
        return page_of(carry_out_on(client, plan, watch), f"{command_line} --connect HOST")


def _command_line(name: str, scale: str, sumo: bool, seed: int) -> str:
    """The command that anyone can run for the same page."""
    more = (" --sumo" if sumo else "") + (f" --seed {seed}" if seed != 1 else "")
    return f"tailroad reproduce {name} --scale {scale}{more}"


def _watch(bar: Progress, task: TaskID, total: int) -> Watch:
    done = 0
    reported_at = time.monotonic()
    began = reported_at

    def on_part(what: str, rollouts: int) -> None:
        bar.update(task, note=what)
        if not stderr.is_terminal:
            click.echo(f"{what}: at most {rollouts:,} rollouts" if rollouts else what, err=True)

    def on_rollouts(count: int) -> None:
        nonlocal done, reported_at
        done += count
        bar.update(task, advance=count)
        now = time.monotonic()
        if not stderr.is_terminal and now - reported_at > REPORT_EVERY_S:
            reported_at = now
            of = f" of {total:,}" if total else ""
            click.echo(f"{done:,}{of} rollouts, {now - began:.0f} s", err=True)

    return Watch(on_part, on_rollouts)
