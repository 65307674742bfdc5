"""`tailroad verify`: whether a record says what it said when it was written."""

from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

import click

from service.evaluation.cores import core_count
from service.front.cli.options import workers_option

if TYPE_CHECKING:
    from service.evaluation.store.jobs import JobStore
    from service.evaluation.verify import Verified


@click.command()
@click.argument("run", type=click.Path(path_type=Path), required=False)
@click.option("--store", "database", help="Instead of RUN: the database of a service, as an URL, or the --home of "
              "`tailroad serve`.")  # fmt: skip
@click.option("--sample", type=click.IntRange(min=0), default=10, show_default=True,
              help="Rollouts of each job to run again, bit for bit.")  # fmt: skip
@click.option("--public-key", type=click.Path(exists=True, dir_okay=False, path_type=Path),
              help="Of a folder of evidence: the key that must have signed it, as minisign writes it.")  # fmt: skip
@workers_option()
def command(
    run: Path | None, database: str | None, sample: int, public_key: Path | None, workers: int | None
) -> None:
    """Check every chunk of RUN, a run directory (or of all jobs of a service, with --store), and run a sample again.

    RUN may be a folder of evidence: its signature, every file's digest and the support of every claim are checked, too.
    Tells what is damaged and what can be saved, changes nothing, and ends with exit code 2 where something is damaged.
    """
    from service.errors import InputError, StoreError
    from service.evaluation.store import RunDirectory
    from service.evaluation.verify import verify

    if (run is None) == (database is None):
        raise InputError("give a run directory or --store, one of them")
    processes = workers or core_count()
    if run is not None and _is_evidence(run):
        _evidence(run, sample, processes, public_key)
        return
    if public_key is not None:
        raise InputError("--public-key is for folders of evidence")
    damaged = log_faults = 0
    if run is not None:
        with RunDirectory.open(run, checked=False) as store:
            wrong = store.wrong()
            for line in wrong:
                click.echo(line)
            for job in store.jobs:
                damaged += _tell(verify(job.id, job, store.record.rows(job.id), sample, processes))
            damaged = damaged or bool(wrong)
    else:
        damaged, log_faults = _of_service(str(database), sample, processes)
    if damaged:
        raise StoreError(
            f"{damaged} {'job is' if damaged == 1 else 'jobs are'} damaged, as told above; nothing was changed: take "
            "the record from a copy, or run the job again"
        )
    if log_faults:
        raise StoreError("the audit log is not as it was written, as told above; the jobs' records are sound")


def _is_evidence(folder: Path) -> bool:
    from service.analysis.evidence.check import is_evidence

    return is_evidence(folder)


def _evidence(folder: Path, sample: int, workers: int, public_key: Path | None) -> None:
    """Check a folder of evidence; StoreError names what is wrong."""
    from service.analysis.evidence.check import check_evidence
    from service.analysis.evidence.signature import read_public_key
    from service.errors import StoreError

    trusted = None
    if public_key is not None:
        trusted = read_public_key(public_key.read_text(encoding="utf-8", errors="replace"))
    found = check_evidence(folder, sample, workers, trusted)
    for record in found.records:
        _tell(record)
    for line in found.wrong:
        click.echo(line)
    if found.wrong:
        raise StoreError(f"{folder} is not the evidence that was signed: {found.wrong[0]}")
    click.echo(f"{found.files} files and {found.claims} claims are as they were signed ({found.comment})")
    if found.trusted:
        click.echo(f"signed with the key given, {found.signed_by}")
    else:
        click.echo(
            f"signed with the folder's own key, {found.signed_by}: compare it with the signer's, or give --public-key"
        )


def _of_service(database: str, sample: int, workers: int) -> tuple[int, int]:
    """How many of its jobs are damaged, and how many faults its audit log has."""
    from service.evaluation.verify import verify
    from service.front.cli.export import store_of

    damaged = 0
    with store_of(database) as store:
        for row in store.jobs(limit=2**31 - 1):
            found = verify(row.id, row.job, store.chunks.rows(row.id), sample, workers)
            wrong = _beside(store, row.id)
            if row.status == "done" and not found.finished:
                wrong.append("the job is done, and its record does not reach its end")
            damaged += _tell(found, tuple(wrong))
        for line in (wrong_log := store.log.wrong()):
            click.echo(line)
    return damaged, len(wrong_log)


def _beside(store: "JobStore", job: str) -> list[str]:
    """What is wrong with what is kept of a job beside its chunks."""
    from service.errors import StoreError

    wrong = []
    try:
        begun, row = store.beginnings.of(job), store.job(job)
        other = begun.differs_from(row.job) if begun is not None and row is not None else None
        if other is not None:
            wrong.append(
                f"the database says {other.path} = {other.now}, and it was begun with {other.path} = {other.then}"
            )
    except StoreError as error:
        wrong.append(str(error))
    if lost := store.chunks.missing().get(job):
        wrong.append(f"the record has lost {lost} chunks of rollouts that were once recorded")
    try:
        store.iterations(job, limit=2**31 - 1)
    except StoreError as error:
        wrong.append(str(error))
    with suppress(StoreError):  # of a damaged chunk, which is told of by itself
        kept = store.states.kept(job, store.epoch(job))
        if kept is not None and not (kept.sound and kept.last.record == store.chunks.digest(job)):
            wrong.append(
                "the state kept of it is not of its record; it is not used, and is made again from its chunks"
            )
    return wrong


def _tell(found: "Verified", more: tuple[str, ...] = ()) -> bool:
    """Whether it is damaged."""
    damage = (*found.damage, *more)
    click.echo(
        f"{found.job}: {found.chunks} chunks, {found.rollouts} rollouts, "
        + ("DAMAGED" if damage else "sound")
        + ("" if found.finished else ", not finished")
    )
    if found.again:
        click.echo(
            f"  {found.again - found.different} of {found.again} rollouts run again are the same to the bit"
        )
    if found.old:
        click.echo(
            f"  {found.old} chunks are of before there were checksums: their values are not checked by one"
        )
    for line in damage:
        click.echo(f"  {line}")
    if damage:
        click.echo(f"  {found.usable} rollouts can be saved; {found.rollouts - found.sound} are damaged")
    return bool(damage)
