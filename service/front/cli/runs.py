"""Commands that read a run: which run, which of its jobs."""

from collections.abc import Callable
from pathlib import Path

import click

from service.errors import InputError
from service.evaluation.record import JobRecord, replay
from service.evaluation.store import RunDirectory


def run_argument(name: str = "run") -> Callable:
    return click.argument(name, type=click.Path(exists=True, file_okay=False, path_type=Path))


def method_option() -> Callable:
    return click.option("--method", help="Whose rollouts, where the run has several methods.  [default: the one "
                        "with most dangerous rollouts]")  # fmt: skip


def open_record(
    run: Path, method: str | None, gamma: float | None = None
) -> tuple[JobRecord, tuple[str, ...]]:
    """The record of one job of a run directory, and the names of all its jobs; gamma: another threshold than the job's.

    Without a method: the job that has met the most dangerous rollouts, in effective numbers.
    """
    with RunDirectory.open(run) as store:
        names = tuple(job.id for job in store.jobs)
        if method is not None:
            if method not in names:
                raise InputError(f"--method {method}: {run} has {', '.join(names)}")
            return replay(store, store.job(method), gamma), names
        records = [replay(store, job, gamma) for job in store.jobs]
    return max(records, key=lambda record: record.estimate.ess), names
