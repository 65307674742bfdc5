"""All jobs of the service, read page by page; those that are over are not read again."""

import time
from collections.abc import Callable

from service.remote.api.objects import OVER, Job
from service.remote.client import Client

PAGE = 500
MOMENT_S = 1.0


class Book:
    """Keeps what was read of jobs. Not for several threads at once: Link asks once for all who wait."""

    def __init__(self, clock: Callable[[], float] = time.monotonic):
        self._clock = clock
        self._jobs: dict[int, Job] = {}
        self._noted: set[str] = set()

    def noted(self, job: str) -> None:
        """Something was said of the job, which is read again."""
        self._noted.add(job)

    def read(self, client: Client) -> list[Job]:
        """Every job, in the order of submission: read on from the first that was not over."""
        open_numbers = [n for n, job in self._jobs.items() if job.status not in OVER]
        after: int | None = min(open_numbers, default=max(self._jobs, default=0) + 1) - 1
        while after is not None:
            page = client.jobs(after, PAGE)
            self._jobs |= {job.number: job for job in page.items}
            after = page.next
        while self._noted:
            job = client.job(self._noted.pop())
            self._jobs[job.number] = job
        return list(self._jobs.values())

    def forget(self) -> None:
        """Another service may have other jobs."""
        self._jobs = {}
