"""`tailroad report RUN`"""

from pathlib import Path

import click

from service.cli.options import core_count, workers_option
from service.cli.runs import run_argument


@click.command()
@run_argument()
@click.option("--out", type=click.Path(path_type=Path), help="Folder for the report.  [default: RUN]")
@click.option("--baseline", help="What the risk is held against: events per million km, or police-reported or "
              "near-crash.  [default: police-reported]")  # fmt: skip
@click.option("--baseline-source", help="Where a number given as --baseline is from.")
@workers_option()
def command(
    run: Path, out: Path | None, baseline: str | None, baseline_source: str | None, workers: int | None
) -> None:
    """Write the HTML report of a run, and a JSON file beside it."""
    from service.report import write_report
    from service.risk import baseline_of
    from service.store import RunDirectory

    against = baseline_of(baseline, baseline_source)
    with RunDirectory.open(run) as store:
        path = write_report(store, out, baseline=against, workers=workers or core_count())
    click.echo(path)
