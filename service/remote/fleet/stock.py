"""What a hub that begins finds in its database: jobs to be taken up, and those that this software cannot go on with.

A job goes on with the software that it was begun with, told by what decides bits and not by a version. One that was
begun with other software needs a restart: its record is kept, and it goes on by itself where that software is back.
"""

import logging
from collections.abc import Sequence

import ce
from service.errors import TailroadError
from service.evaluation.job import held_bytes
from service.evaluation.software import Software, software
from service.evaluation.store.beginnings import Beginning
from service.evaluation.store.jobs import OPEN, JobRow, JobStore

NEEDS_RESTART = "needs-restart"

log = logging.getLogger("tailroad.hub")


def take_stock(store: JobStore, here: Software | None = None) -> list[JobRow]:
    """The jobs to be taken up, after the others are given their statuses, each with a line in the log; StoreError where
    the database cannot be read.

    here: in place of this installation's software
    """
    present, begun = here or software(), store.beginnings.all()
    missing = store.chunks.missing()
    found = []
    for row in store.jobs_with((*OPEN, NEEDS_RESTART)):
        why = _in_the_way(row, begun.get(row.id), present)
        if row.status == NEEDS_RESTART and not why:
            reason = "taken up again: the software that it was begun with is back"
            found.append(_set(store, row, _status_before(store, row.id), reason))
        elif row.status != NEEDS_RESTART and why:
            _set(store, row, NEEDS_RESTART, why)
        elif not why:
            found.append(row)
    return [*found, *_taken_up_for_loss(store, missing, begun, present)]


def _in_the_way(row: JobRow, begun: Beginning | None, present: Software) -> str:
    """Why this software does not go on with a job, "" where it does."""
    if begun is None:  # of before it was written down
        return ""
    if other := begun.differs_from(row.job):
        return (
            f"the database says {other.path} = {other.now}, and it was begun with {other.path} = {other.then}; its "
            "record is kept: put it back, or submit the job again"
        )
    if differs := present.differs_from(begun.software):
        return (
            f"it was begun with other software: here is {differs}; its record is kept: start the service with that "
            "software to go on with it, or submit the job again"
        )
    return ""


def _taken_up_for_loss(
    store: JobStore, missing: dict[str, int], begun: dict[str, Beginning], present: Software
) -> Sequence[JobRow]:
    """Jobs that were done with rollouts that the record has lost since: they are run again, to the same bits."""
    found = []
    for name, count in missing.items():
        row = store.job(name)
        if row is None:
            continue
        lost = f"the record has lost {count} chunks of its rollouts"
        if row.status == "done" and not _in_the_way(row, begun.get(name), present):
            found.append(_set(store, row, "running", f"taken up again: {lost}, which are run again"))
        else:
            log.warning("job %s (%s): %s", name, row.status, lost)
        store.chunks.count_anew(name)
    return found


def _status_before(store: JobStore, job: str) -> str:
    """The status that a job had when it was found to need a restart: running or paused."""
    told = [event.body["status"] for event in store.events(job, limit=2**31 - 1) if event.kind == "status"]
    return next((status for status in reversed(told) if status in OPEN), "running")


def _set(store: JobStore, row: JobRow, status: str, reason: str) -> JobRow:
    log.warning("job %s is %s: %s", row.id, status, reason)
    store.add_event(row.id, "status", {"status": status, "reason": reason})
    again = store.job(row.id)
    assert again is not None
    return again


def held_bytes_of(row: JobRow) -> int:
    """Memory that a job takes while it is open, at most."""
    try:
        return held_bytes(row.job)
    except (TailroadError, ce.CeError):
        return 0  # it cannot be opened either, which is told then
