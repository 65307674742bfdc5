"""Parameters against f: what the page's script draws, asked for and made small enough for a browser."""

from starlette.requests import Request

from service.analysis.learned.scatter_objects import Scatter
from service.front.dashboard.link import FOR_GOOD_S
from service.front.dashboard.pages.job import HEAD, job_of
from service.front.dashboard.site import Site
from service.remote.api.objects import OVER

WHILE_RUNNING_S = 30.0  # rollouts are run again for what the drivers did


async def scatter(site: Site, request: Request) -> Scatter:
    """Cells and dangerous rollouts of the job."""
    job = await job_of(site, request)
    return await site.link.ask(
        ("scatter", job.id, job.status),
        lambda client: client.scatter(job.id),
        FOR_GOOD_S if job.status in OVER else WHILE_RUNNING_S,
    )


PARTS = (HEAD,)
