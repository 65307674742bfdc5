"""`tailroad batch FILE.toml`: many questions at once, on this machine or by a service."""

import csv
import sys
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

import click
import msgspec
from rich.console import Console
from rich.table import Table

from service.analysis.run.bars import progress_bar, stderr
from service.evaluation.cores import core_count
from service.front.cli.main import INTERRUPTED
from service.front.cli.options import (
    FOLDER,
    connect_option,
    finite,
    json_option,
    workers_option,
    zenoh_config_option,
)
from service.front.cli.tables import whole
from service.front.matrix.plan import Batch, Cell, cells, read_batch
from service.front.matrix.verdict import Result, exit_code

COLOURS = {"below": "green", "above": "red", "not-below": "red", "inconclusive": "yellow", "not-run": "red"}


@click.command()
@click.argument("file", type=click.Path(exists=True, dir_okay=False, path_type=Path))
@click.option("--fail-above", type=click.FloatRange(0, 1, min_open=True, max_open=True), callback=finite,
              help="Fail where the upper bound of p exceeds this.  [default: fail_above of the file]")  # fmt: skip
@click.option("--out", type=FOLDER, help="Folder of the runs, results.json and "
              "results.csv.  [default: batch-NAME]")  # fmt: skip
@connect_option("Have the service at this Zenoh endpoint run it, instead of this machine")
@zenoh_config_option()
@workers_option()
@json_option()
def command(
    file: Path,
    fail_above: float | None,
    out: Path | None,
    connect: tuple[str, ...],
    zenoh_config: str | None,
    workers: int | None,
    as_json: bool,
) -> None:
    """Run every scenario x ego x threshold x method of FILE and tell the results in one table.

    The same command goes on where it was interrupted, and runs nothing twice. FILE is TOML:

    \b
        format = 1
        name = "nightly"
        scenarios = ["i80-10s", "mine.toml"]
        egos = ["lidar", "idm"]
        gammas = [0.5, 0.2]
        methods = ["auto"]        # optional, as are the following
        budget = 20000            # rollouts of a cell
        rel_error = 0.3
        confidence = 0.95
        seed = 1
        fail_above = 1e-3
        [options.ce]              # of a method
        rho = 0.1

    \b
    Exit codes, the first that applies:
      130  interrupted
      2    bad input
      1    the upper bound of some p exceeds --fail-above
      5    some cell could not be run to its end
      4    inconclusive: some interval lies below --fail-above, but warnings say that it cannot be relied on
      3    some cell did not reach the precision asked for (rel_error)
      0    all is done, and every interval lies below --fail-above where that is given
    """
    batch = read_batch(file)
    limit = batch.fail_above if fail_above is None else fail_above
    folder = out or Path(f"batch-{batch.name}")
    planned = list(cells(batch, file.parent))
    try:
        with _results(batch, planned, folder, connect, zenoh_config, workers, limit) as results:
            found = list(_shown(results, planned))
    except KeyboardInterrupt:
        stderr.print("\nInterrupted; what was run is kept. The same command goes on.")
        sys.exit(INTERRUPTED)
    _write(folder, batch, limit, found)
    if as_json:
        click.echo(_as_json(batch, limit, found).decode())
    else:
        _print(found, limit)
    sys.exit(exit_code(found))


@contextmanager
def _results(
    batch: Batch,
    planned: list[Cell],
    folder: Path,
    connect: tuple[str, ...],
    zenoh_config: str | None,
    workers: int | None,
    limit: float | None,
) -> Iterator[Iterable[Result]]:
    if connect:
        from service.front.matrix.remote import submit_all, wait_for_all
        from service.remote.client import Client

        with Client(connect, zenoh_config) as client:
            yield wait_for_all(client, planned, submit_all(client, batch.name, planned), limit)
    else:
        from service.front.matrix.local import jobs_of_cells, run_locally

        yield run_locally(planned, jobs_of_cells(planned), folder / "cells", workers or core_count(), limit)


def _shown(results: Iterable[Result], planned: list[Cell]) -> Iterator[Result]:
    with progress_bar() as bar:
        task = bar.add_task("cells", total=len(planned), note=planned[0].title)
        for number, result in enumerate(results, start=1):
            note = planned[number].title if number < len(planned) else ""
            bar.update(task, advance=1, note=note)
            if not stderr.is_terminal:
                click.echo(
                    f"{number} of {len(planned)}: {planned[number - 1].title}: {_result_text(result)}",
                    err=True,
                )
            yield result


def _result_text(result: Result) -> str:
    if result.p is None:
        return f"{result.status}: {result.reason}" if result.reason else "p not known"
    return f"p = {result.p:.3g} [{result.low:.3g}, {result.high:.3g}], {result.verdict}"


def _as_json(batch: Batch, limit: float | None, found: list[Result]) -> bytes:
    whole = {"name": batch.name, "fail_above": limit, "exit_code": exit_code(found), "results": found}
    return msgspec.json.format(msgspec.json.encode(whole), indent=2)


def _write(folder: Path, batch: Batch, limit: float | None, found: list[Result]) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "results.json").write_bytes(_as_json(batch, limit, found) + b"\n")
    with (folder / "results.csv").open("w", encoding="utf-8", newline="") as out:
        writer = csv.DictWriter(out, Result.__struct_fields__)
        writer.writeheader()
        for result in found:
            row = msgspec.structs.asdict(result)
            writer.writerow(row | {"warnings": " ".join(result.warnings)})


def _print(found: list[Result], limit: float | None) -> None:
    console = Console()
    table = Table(
        "scenario\nego",
        "gamma\nmethod",
        whole("p\ninterval"),
        whole("rollouts\nevents"),
        "verdict",
    )
    for r in found:
        colour = COLOURS.get(r.verdict, "default")
        known = r.p is not None
        table.add_row(
            f"{Path(r.scenario).stem}\n{r.ego}",
            f"{r.gamma:g}\n{r.method}",
            f"{r.p:.3g}\n{r.low:.3g} to {r.high:.3g}" if known else "-",
            f"{r.rollouts:,}\n{r.events:,}",
            f"[{colour}]{r.verdict}[/{colour}]",
        )
    console.print(table)
    if limit is not None:
        console.print(f"Limit: the upper bound of p must not exceed {limit:g}.", highlight=False)
    for r in found:
        for text in (*([r.reason] if r.reason else []), *r.warnings):
            console.print(
                f"{Path(r.scenario).stem}, {r.ego}, {r.gamma:g}, {r.method}: {text}", highlight=False
            )
