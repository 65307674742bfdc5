"""`tailroad export`: a record as a table."""

from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING

import click

if TYPE_CHECKING:
    from service.evaluation.store.jobs import JobStore

FLEET = "fleet.sqlite"


def store_of(database: str) -> "JobStore":
    """The record of a service, by the URL of its database or its --home; InputError where there is none."""
    from service.errors import InputError
    from service.evaluation.store.database import sqlite_url
    from service.evaluation.store.jobs import JobStore

    file = Path(database) / FLEET
    if "://" not in database and not file.is_file():
        raise InputError(f"{database}: give the URL of a database, or a folder that holds {FLEET}")
    return JobStore(database if "://" in database else sqlite_url(file), new=False)


@click.command()
@click.argument("run")
@click.option(
    "--parquet", type=click.Path(dir_okay=False, path_type=Path), required=True, help="File to write."
)
@click.option("--job", "chosen", multiple=True, help="Only this job; once for each.  [default: all]")
def command(run: str, parquet: Path, chosen: tuple[str, ...]) -> None:
    """Write every rollout of RUN to a Parquet file, with f, outcome, steps, error, worker, and how vehicles touched.

    RUN is a run directory of `tailroad estimate`, the --home of `tailroad serve`, or the URL of a database.
    """
    from service.errors import InputError
    from service.evaluation.pool import OUTCOME_NAMES
    from service.evaluation.store import RunDirectory
    from service.evaluation.store.database import sqlite_url
    from service.evaluation.store.export import write_parquet
    from service.evaluation.store.jobs import JobStore
    from service.front.cli.options import require_folder

    require_folder(parquet, "--parquet")
    with ExitStack() as stack:
        if "://" in run or (Path(run) / FLEET).is_file():
            store = stack.enter_context(JobStore(run if "://" in run else sqlite_url(Path(run) / FLEET)))
            record, names = store.chunks, [row.id for row in store.jobs(limit=2**31 - 1)]
        else:
            directory = stack.enter_context(RunDirectory.open(Path(run)))
            record, names = directory.record, [job.id for job in directory.jobs]
        for name in chosen:
            if name not in names:
                raise InputError(f"--job {name}: {run} has no such job; it has {', '.join(names) or 'none'}")
        wanted = {name: record.with_origins(name) for name in chosen or names}
        rollouts = write_parquet(parquet, wanted, OUTCOME_NAMES)
    click.echo(f"{rollouts} rollouts of {len(wanted)} jobs: {parquet}")
