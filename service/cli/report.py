"""`tailroad report RUN`"""

from pathlib import Path

import click


@click.command()
@click.argument("run", type=click.Path(exists=True, file_okay=False, path_type=Path))
@click.option("--out", type=click.Path(path_type=Path), help="Folder for the report.  [default: RUN]")
def command(run: Path, out: Path | None) -> None:
    """Write the HTML report of a run, and a JSON file beside it."""
    from service.report import write_report
    from service.store import RunDirectory

    with RunDirectory.open(run) as store:
        click.echo(write_report(store, out))
