"""`tailroad compare`: egos on the same draws, or runs."""

from collections.abc import Sequence
from datetime import datetime
from pathlib import Path
from string import ascii_lowercase
from typing import Any

import click
import msgspec
from rich.console import Console
from rich.table import Table
from rich.text import Text

import ce
from service.analysis.comparison.compare import comparison_of
from service.analysis.comparison.objects import Comparison, ModeChange, Pair
from service.analysis.failures.examine import EXAMINED
from service.analysis.run.records import record_of
from service.analysis.wording import quantity, significant
from service.errors import InputError, StoreError
from service.evaluation.campaign import Watcher, run_job
from service.evaluation.cores import core_count
from service.evaluation.job import Job, make_job
from service.evaluation.record import JobRecord, replay
from service.evaluation.store import Chunk, RunDirectory
from service.front.cli.ego_options import ego_option
from service.front.cli.main import INTERRUPTED
from service.front.cli.options import finite, json_option, seed_option, workers_option
from service.front.cli.progress import progress_bar, stderr
from service.world.scenario import load_scenario
from service.world.scenario.check import check_road


@click.command()
@click.argument("what", nargs=-1, required=True, metavar="SCENARIO | RUN...")
@ego_option(multiple=True)
@click.option("--gamma", type=float, callback=finite, help="The event is f <= GAMMA, in the measure's unit.  "
              "[RUN...: default: their own]")  # fmt: skip
@click.option("--method", type=click.Choice(ce.METHODS), help="SCENARIO: how p is estimated.  [default: naive]  "
              "RUN...: which of their jobs.  [default: one that all have]")  # fmt: skip
@click.option("--budget", type=click.IntRange(1), default=20_000, show_default=True,
              help="SCENARIO: rollouts of each ego at most.")  # fmt: skip
@seed_option()
@click.option("--examine", type=click.IntRange(0), default=EXAMINED, show_default=True,
              help="Dangerous rollouts of each at most to run again and group into failure modes.")  # fmt: skip
@click.option("--out", type=click.Path(file_okay=False, path_type=Path), help="SCENARIO: folder for the run "
              "directories; what it holds already is continued.  [default: runs/compare-SCENARIO-TIME]")  # fmt: skip
@click.option("--html", type=click.Path(dir_okay=False, path_type=Path), help="Write a page to this file.")
@workers_option()
@json_option()
def command(
    what: tuple[str, ...],
    ego: tuple[str, ...],
    gamma: float | None,
    method: str | None,
    budget: int,
    seed: int,
    examine: int,
    out: Path | None,
    html: Path | None,
    workers: int | None,
    as_json: bool,
) -> None:
    """Compare egos on SCENARIO (--ego A --ego B ...), run on the same draws, or finished runs.

    Each against each that stands before it: difference and ratio of p with intervals, p(gamma) of all, and which ways
    to fail came and went.
    """
    count = workers or core_count()
    runs: list[Path]
    if len(what) == 1 and not (Path(what[0]) / "run.json").exists():
        runs, records = _run_all(what[0], ego, gamma, method or "naive", budget, seed, out, count)
    else:
        if ego or out is not None:
            raise InputError("runs have their own egos: leave out --ego and --out")
        runs = [Path(name) for name in what]
        records = _open_all(runs, method, gamma)
    with progress_bar() as bar:
        task = bar.add_task("dangerous rollouts", total=None, note="")
        found = comparison_of(
            records,
            [str(run) for run in runs],
            examine,
            count,
            runs,
            lambda done, total: bar.update(task, completed=done, total=total),
        )
    if html is not None:
        from service.analysis.report.comparison import write_comparison

        write_comparison(found, html)
    if as_json:
        click.echo(msgspec.json.format(msgspec.json.encode(found), indent=2).decode())
        return
    _print(found)
    if html is not None:
        click.echo(f"Page: {html}")


def _run_all(
    name: str,
    egos: tuple[str, ...],
    gamma: float | None,
    method: str,
    budget: int,
    seed: int,
    out: Path | None,
    workers: int,
) -> tuple[list[Path], list[JobRecord]]:
    """Run every ego, each into its own run directory, as far as it is not there already."""
    if len(egos) < 2 or len(set(egos)) < len(egos):
        given = f"{', '.join(egos)}" if egos else "none"
        raise InputError(f"--ego: give two or more different egos, as in --ego idm --ego lidar, not {given}")
    if gamma is None:
        raise InputError("give the event's threshold in the measure's unit, as in --gamma 0.5")
    scenario = load_scenario(name)
    check_road(scenario, name)
    jobs = [make_job(scenario, ego, gamma, method, seed, {"budget": budget}) for ego in egos]
    folder = out or Path("runs") / f"compare-{scenario.name}-{datetime.now():%Y%m%d-%H%M%S}"
    paths = [folder / f"{letter}-{_plain(ego)}" for letter, ego in zip(ascii_lowercase, egos, strict=False)]
    records = []
    try:
        for job, path in zip(jobs, paths, strict=True):
            with _opened(path, job) as store:
                _run(store, job, workers)
                records.append(replay(store, job))
    except KeyboardInterrupt:
        stderr.print(
            f"\nInterrupted; what was run is kept. Continue with the same command and --out {folder}"
        )
        raise SystemExit(INTERRUPTED) from None
    return paths, records


def _plain(ego: str) -> str:
    return "".join(c if c.isalnum() or c in "._-" else "-" for c in ego)


def _opened(path: Path, job: Job) -> RunDirectory:
    if not (path / "run.json").exists():
        return RunDirectory.create(path, (job,))
    store = RunDirectory.open(path)
    if store.jobs != (job,):
        store.close()
        raise StoreError(f"{path} holds a run of another question; give another --out")
    return store


def _run(store: RunDirectory, job: Job, workers: int) -> None:
    with progress_bar() as bar:
        task = bar.add_task(f"{job.ego}: starting {workers} workers", total=None, note="")

        def on_job(job: Job, total: int) -> None:
            bar.update(task, total=total, description=job.ego)
            if not stderr.is_terminal:
                click.echo(
                    f"{job.ego}: at most {total:,} rollouts on {workers} workers, run {store.path}", err=True
                )

        def on_chunk(chunk: Chunk, replayed: bool) -> None:
            bar.update(task, advance=chunk.stop - chunk.start)

        def on_record(state: Any, record: ce.TrainingRecord | ce.EstimationRecord) -> None:
            if isinstance(record, ce.EstimationRecord):
                bar.update(task, note=f"p = {record.p:.3g} [{record.low:.2g}, {record.high:.2g}]")

        run_job(store, job, workers, Watcher(on_job, on_chunk, on_record))


def _open_all(runs: Sequence[Path], method: str | None, gamma: float | None) -> list[JobRecord]:
    """The records of the runs' jobs: of the method given, else of the first that all have, else the best of each.

    Raises StoreError where a run cannot be read and InputError where it has no such method.
    """
    if method is None:
        names = []
        for run in runs:
            with RunDirectory.open(run) as store:
                names.append([job.id for job in store.jobs])
        method = next((name for name in names[0] if all(name in others for others in names[1:])), None)
    return [record_of(run, method, gamma)[0] for run in runs]


HOW = {"normal": "normal", "paired counts": "exact, of the pairs", "bounds": "bounds of both intervals"}


def _print(found: Comparison) -> None:
    console = Console()
    level = f"{found.confidence:.0%}"
    console.print(f"\np = P0(f <= {quantity(found.gamma, found.unit)})")
    table = Table("", *[side.name for side in found.sides])
    rows = [
        ("scenario, ego", [f"{s.scenario}, {s.ego}" for s in found.sides]),
        ("method, rollouts", [f"{s.method}, {s.rollouts:,}" for s in found.sides]),
        ("p", [significant(s.p) for s in found.sides]),
        (f"{level} interval", [_span(s.ci) for s in found.sides]),
        ("dangerous rollouts (effective)", [f"{s.events:,} ({significant(s.ess)})" for s in found.sides]),
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
    table = Table("", f"{b.name} against {a.name}", f"{level} interval", "how")
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
        table = Table("failure mode", f"{a.name}: p", f"{b.name}: p", "difference", f"{level} interval", "")
        for mode in pair.modes:
            table.add_row(
                Text(mode.mode, no_wrap=True),
                significant(mode.a.p, 2),
                significant(mode.b.p, 2),
                significant(mode.difference.difference, 2),
                _span(mode.difference.difference_ci),
                _change(mode),
            )
        console.print(table)
    console.print(pair.summary, highlight=False)


def _change(mode: ModeChange) -> str:
    return "not distinguishable" if mode.change == "unclear" else mode.change


def _span(ci: tuple[float, float | None]) -> str:
    low, high = ci
    return f"{significant(low, 2)} to {'∞' if high is None else significant(high, 2)}"
