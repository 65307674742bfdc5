"""The verdict on a job's dangerous rollouts: what a competent driver would have prevented, how severe contacts are."""

from typing import Any

from starlette.requests import Request

from service.front.dashboard.link import FOR_GOOD_S
from service.front.dashboard.pages.failures import ENDS
from service.front.dashboard.pages.job import HEAD, job_of
from service.front.dashboard.pages.rollouts import replay_address
from service.front.dashboard.site import Part, Site
from service.remote.api.objects import OVER

WHILE_RUNNING_S = 60.0  # rollouts are driven again
LISTED = 20


async def prevention(site: Site, request: Request) -> dict[str, Any]:
    """By each reference driver, as a whole and by mode, and what became of single rollouts."""
    job = await job_of(site, request)
    found = await site.link.ask(
        ("prevention", job.id, job.status),
        lambda client: client.prevention(job.id),
        FOR_GOOD_S if job.status in OVER else WHILE_RUNNING_S,
    )
    modes = list(zip(*(one.modes for one in found.references), strict=True))
    rows = [
        (one, replay_address(job.id, "estimate", one.iteration, one.row)) for one in found.rollouts[:LISTED]
    ]
    return {"job": job, "found": found, "modes": modes, "rows": rows, "ends": ENDS}


async def severity(site: Site, request: Request) -> dict[str, Any]:
    """Contacts by the change of the ego's velocity, the risk of injury, the severest ones."""
    job = await job_of(site, request)
    found = await site.link.ask(
        ("severity", job.id, job.status),
        lambda client: client.severity(job.id),
        FOR_GOOD_S if job.status in OVER else WHILE_RUNNING_S,
    )
    rows = [
        (one, replay_address(job.id, "estimate", one.iteration, one.row)) for one in found.contacts[:LISTED]
    ]
    return {"job": job, "found": found, "rows": rows}


PARTS = (
    HEAD,
    Part("prevention", "What was preventable", prevention, ("status",)),
    Part("severity", "How severe contacts are", severity, ("status",)),
)
