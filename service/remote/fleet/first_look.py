"""A look at the record before a service goes on with it: are its chunks what they were when they were written?

It takes so long and no longer; `tailroad verify` looks at all of it, and runs a sample again.
"""

import logging
import time
from collections.abc import Callable
from dataclasses import dataclass

from service.errors import StoreError
from service.evaluation.store.chunk import chunk_of
from service.evaluation.store.jobs import OPEN, JobStore

log = logging.getLogger("tailroad.hub")


@dataclass(frozen=True)
class Looked:
    """What was found.

    chunks: that were read
    jobs: that were read to their end
    left: jobs that were not, for want of time
    damaged: what is wrong, a sentence for each job
    """

    chunks: int
    jobs: int
    left: int
    damaged: tuple[str, ...]


def first_look(store: JobStore, limit_s: float, clock: Callable[[], float] = time.monotonic) -> Looked:
    """Read chunks for limit_s at most, those of open jobs first, then of the latest."""
    until = clock() + limit_s
    rows = sorted(store.jobs(limit=2**31 - 1), key=lambda row: (row.status not in OPEN, -row.number))
    chunks = jobs = 0
    damaged: list[str] = []
    for done, row in enumerate(rows):
        wrong: list[str] = []
        try:
            for chunk in store.chunks.rows(row.id):
                if clock() >= until:
                    return Looked(chunks, jobs, len(rows) - done, _told(damaged, row.id, wrong))
                chunks += 1
                try:
                    chunk_of(chunk)
                except StoreError as error:
                    wrong.append(str(error))
        except StoreError as error:
            wrong.append(str(error))
        damaged = list(_told(damaged, row.id, wrong))
        jobs += 1
    return Looked(chunks, jobs, 0, tuple(damaged))


def _told(damaged: list[str], job: str, wrong: list[str]) -> tuple[str, ...]:
    if not wrong:
        return tuple(damaged)
    more = f", and {len(wrong) - 1} more" if len(wrong) > 1 else ""
    return (*damaged, f"job {job}: {wrong[0]}{more}")


def log_look(looked: Looked) -> None:
    """A line of what was looked at, and one for each job that is damaged."""
    rest = f"; {looked.left} jobs are left: `tailroad verify --store` looks at all" if looked.left else ""
    log.info("%d chunks of %d jobs were checked before the start%s", looked.chunks, looked.jobs, rest)
    for line in looked.damaged:
        log.error("%s", line)
