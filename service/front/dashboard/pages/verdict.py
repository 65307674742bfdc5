"""The verdict on a job's dangerous rollouts: what a competent driver would have prevented, how severe contacts are."""

from collections.abc import Callable, Sequence
from typing import Any, TypeVar

from starlette.requests import Request

from service.analysis.prevention.objects import Prevented
from service.analysis.severity.objects import Severe
from service.front.dashboard.pages.failures import ENDS
from service.front.dashboard.pages.job import HEAD, job_of, keep_s
from service.front.dashboard.pages.rollouts import replay_address
from service.front.dashboard.site import Part, Site
from service.remote.api.objects import Job
from service.remote.client import Client

WHILE_RUNNING_S = 60.0  # rollouts are driven again
LISTED = 20
Finding = TypeVar("Finding")


async def _asked(
    site: Site, request: Request, name: str, ask: Callable[[Client, str], Finding]
) -> tuple[Job, Finding]:
    """The page's job, and what the service finds of it."""
    job = await job_of(site, request)
    key = (name, job.id, job.status)
    return job, await site.link.ask(key, lambda client: ask(client, job.id), keep_s(job, WHILE_RUNNING_S))


async def prevention(site: Site, request: Request) -> dict[str, Any]:
    """By each reference driver, as a whole and by mode, and what became of single rollouts."""
    job, found = await _asked(site, request, "prevention", Client.prevention)
    modes = list(zip(*(one.modes for one in found.references), strict=True))
    return {"job": job, "found": found, "modes": modes, "rows": _rows(job, found.rollouts), "ends": ENDS}


async def severity(site: Site, request: Request) -> dict[str, Any]:
    """Contacts by the change of the ego's velocity, the risk of injury, the severest ones."""
    job, found = await _asked(site, request, "severity", Client.severity)
    return {"job": job, "found": found, "rows": _rows(job, found.contacts)}


def _rows(job: Job, found: Sequence[Prevented] | Sequence[Severe]) -> list[tuple[Prevented | Severe, str]]:
    """The first of them, each with the address of its replay."""
    return [(one, replay_address(job.id, "estimate", one.iteration, one.row)) for one in found[:LISTED]]


PARTS = (
    HEAD,
    Part("prevention", "What was preventable", prevention, ("status",)),
    Part("severity", "How severe contacts are", severity, ("status",)),
)
