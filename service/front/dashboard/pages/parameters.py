"""Parameters against f: what the page's script draws, asked for and made small enough for a browser."""

from starlette.requests import Request

from service.analysis.learned.scatter_objects import Scatter
from service.front.dashboard.pages.job import HEAD, job_of, keep_s
from service.front.dashboard.site import Site

WHILE_RUNNING_S = 30.0  # rollouts are run again for what the drivers did


async def scatter(site: Site, request: Request) -> Scatter:
    """Cells and dangerous rollouts of the job."""
    job = await job_of(site, request)
    return await site.link.ask(
        ("scatter", job.id, job.status),
        lambda client: client.scatter(job.id),
        keep_s(job, WHILE_RUNNING_S),
    )


PARTS = (HEAD,)
