"""What a job told, in order: its statuses, workers that refused it, disputes, chunks that were void."""

from typing import Any

from starlette.requests import Request

from service.front.dashboard.pages.job import HEAD, job_of, keep_s
from service.front.dashboard.site import Part, Site
from service.remote.api.objects import Event
from service.remote.client import Client

PAGE = 1000
SHOWN = 500  # the newest


async def log(site: Site, request: Request) -> dict[str, Any]:
    """The events that are kept, the newest first."""
    job = await job_of(site, request)
    events = await site.link.ask(
        ("log", job.id, job.status),
        lambda client: _all(client, job.id),
        keep_s(job),
    )
    return {"job": job, "events": events[::-1][:SHOWN], "total": len(events)}


def _all(client: Client, job: str) -> list[Event]:
    found: list[Event] = []
    after: int | None = 0
    while after is not None:
        page = client.events(job, after, PAGE)
        found += page.items
        after = page.next
    return found


PARTS = (
    HEAD,
    Part("log", "Log", log, ("status", "quarantine", "refused", "waiting", "disputed"), every_s=None),
)
