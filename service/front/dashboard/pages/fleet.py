"""The fleet: who works, on what, how fast; chunks that were lost, copied and audited; what happened to workers."""

import asyncio
import time
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

from starlette.requests import Request

from service.front.dashboard.pages.jobs import all_jobs
from service.front.dashboard.site import Part, Site
from service.remote.api.objects import OVER, Event, Job, Tally, Worker
from service.remote.client import Client, Refused

EVERY_S = 3.0
PAGE = 1000
MEMORY_S = 60.0  # over which a worker's rate is measured
WORKER_EVENTS = ("refused", "quarantine", "waiting")  # kinds of events that are about workers
JOBS_READ, EVENTS_SHOWN = 10, 20


@dataclass
class WorkerRates:
    """Rollouts a second of each worker, from what it has answered at the times that somebody looked."""

    seen: dict[str, deque[tuple[float, int]]] = field(default_factory=dict)

    def observe(self, workers: Sequence[Worker], now: float) -> None:
        here = {worker.id for worker in workers}
        for gone in set(self.seen) - here:
            del self.seen[gone]
        for worker in workers:
            samples = self.seen.setdefault(worker.id, deque())
            if samples and worker.rollouts < samples[-1][1]:
                samples.clear()  # another worker of that name
            samples.append((now, worker.rollouts))
            while len(samples) > 2 and now - samples[0][0] > MEMORY_S:
                samples.popleft()

    def of(self, worker: str) -> float | None:
        samples = self.seen.get(worker)
        if samples is None or len(samples) < 2 or samples[-1][0] <= samples[0][0]:
            return None
        return (samples[-1][1] - samples[0][1]) / (samples[-1][0] - samples[0][0])


class FleetPage:
    """The page, with what it remembers of the rates."""

    def __init__(self) -> None:
        self._rates = WorkerRates()
        self.parts = (
            Part("fleet", "Workers", self.workers, ("status",), EVERY_S),
            Part(
                "worker_events",
                "Events of workers",
                worker_events,
                ("status", "quarantine", "refused", "waiting"),
            ),
        )

    async def workers(self, site: Site, request: Request) -> dict[str, Any]:
        """Workers with what each does now."""
        found, jobs = await asyncio.gather(site.link.ask("workers", _all_workers), all_jobs(site))
        here = [worker for worker in found if not worker.quarantine]
        self._rates.observe(here, time.monotonic())
        rates = {worker.id: self._rates.of(worker.id) for worker in here}
        known = [rate for rate in rates.values() if rate is not None]
        open_jobs = [job for job in jobs if job.status == "running"]
        return {
            "here": here,
            "wrong": [worker for worker in found if worker.quarantine],
            "rates": rates,
            "per_s": sum(known) if known else None,
            "procs": sum(worker.procs for worker in here),
            "labels": {job.id: job.label or job.id for job in jobs},
            "open_jobs": open_jobs,
            "tally": await _tally(site),
        }


async def _tally(site: Site) -> Tally | None:
    """None where the service does not tell."""
    try:
        return await site.link.ask("tally", lambda client: client.tally())
    except Refused as refused:
        if refused.kind == "no-such-key":
            return None
        raise


def _all_workers(client: Client) -> list[Worker]:
    found: list[Worker] = []
    after: str | None = ""
    while after is not None:
        page = client.workers(after, PAGE)
        found += page.items
        after = page.next
    return found


async def worker_events(site: Site, request: Request) -> dict[str, Any]:
    """Events about workers of the newest jobs and those that run, the newest first."""
    jobs = sorted(await all_jobs(site), key=lambda job: (job.status not in OVER, job.number), reverse=True)
    asked = jobs[:JOBS_READ]
    lists = await asyncio.gather(*(_events(site, job) for job in asked))
    events = sorted(
        (e for found in lists for e in found if e.kind in WORKER_EVENTS), key=lambda e: e.at, reverse=True
    )
    return {"events": events[:EVENTS_SHOWN], "labels": {job.id: job.label or job.id for job in asked}}


async def _events(site: Site, job: Job) -> Sequence[Event]:
    page = await site.link.ask(
        ("events", job.id, job.status), lambda client: client.events(job.id, limit=PAGE), 10.0
    )
    return page.items
