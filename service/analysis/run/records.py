"""The record of a run's job, and files made of it."""

from collections.abc import Callable
from pathlib import Path

from service.errors import InputError, StoreError
from service.evaluation.record import JobRecord, replay
from service.evaluation.store import RunDirectory


def record_of(
    run: Path, job: str | None = None, gamma: float | None = None, outcome: str | None = None
) -> tuple[JobRecord, tuple[str, ...]]:
    """The record of one job of a run directory, and the ids of all its jobs.

    gamma: another threshold than the job's
    outcome: the rollouts that ended so are the event instead

    Without an id: the job that has met the most dangerous rollouts, in effective numbers.
    """
    with RunDirectory.open(run) as store:
        names = tuple(job.id for job in store.jobs)
        if job is not None:
            if job not in names:
                raise InputError(f"{run} has no job {job!r} (--method); it has {', '.join(names)}")
            return replay(store, store.job(job), gamma, outcome), names
        records = [replay(store, one, gamma, outcome) for one in store.jobs]
    return max(records, key=lambda record: record.estimate.ess), names


def write_file(path: Path, suffix: str, content: Callable[[], bytes]) -> Path:
    """Write a file that must end with `suffix`; its path. What it says is made when all else is well."""
    if path.suffix != suffix:
        raise InputError(f"{path}: give a file that ends with {suffix}")
    if not path.resolve().parent.is_dir():
        raise InputError(f"{path}: the folder {path.resolve().parent} does not exist; make it first")
    data = content()
    try:
        path.write_bytes(data)
    except OSError as error:
        raise StoreError(f"cannot write {path}: {error.strerror or error}") from error
    return path
