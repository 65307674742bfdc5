"""What the search learned: each start under base and proposal, and how the drivers drive."""

from collections.abc import Sequence
from typing import Any

from markupsafe import Markup
from starlette.requests import Request

from service.analysis.learned.objects import Parameter, Spread
from service.front.dashboard.pages.job import job_of, keep_s
from service.front.dashboard.site import Part, Site

WHILE_RUNNING_S = 60.0  # rollouts are run again for the behaviours
WIDTH, HEIGHT = 220, 34
KINDS = {"position": "Where they start", "offset": "Where in the lane", "heading": "Heading", "speed": "Speed",
         "weather": "Weather"}  # fmt: skip


async def learned(site: Site, request: Request) -> dict[str, Any]:
    """Parameters by kind, each with its strip of both distributions."""
    job = await job_of(site, request)
    if job.method == "naive":
        return {"found": None, "groups": []}
    found = await site.link.ask(
        ("learned", job.id, job.status),
        lambda client: client.learned(job.id),
        keep_s(job, WHILE_RUNNING_S),
    )
    groups = [
        (heading, [(one, strip(one, _same_kind(found.parameters, kind))) for one in _same_kind(found.parameters, kind)])
        for kind, heading in KINDS.items()
    ]  # fmt: skip
    return {"found": found, "groups": [(heading, rows) for heading, rows in groups if rows]}


def _same_kind(parameters: Sequence[Parameter], kind: str) -> list[Parameter]:
    return [one for one in parameters if one.kind == kind]


def strip(one: Parameter, alike: Sequence[Parameter]) -> Markup:
    """Both distributions as bars from the 5% to the 95% quantile, on the axis of their kind."""
    spreads = [s for other in alike for s in (other.base, other.proposal) if s is not None]
    low, high = min(s.q05 for s in spreads), max(s.q95 for s in spreads)

    def place(value: float) -> float:
        return 4 + (WIDTH - 8) * ((value - low) / (high - low) if high > low else 0.5)

    def bar(spread: Spread, y: int, tone: int) -> Markup:
        return Markup(
            '<g class="tone-{}"><line class="reach" x1="{:.1f}" x2="{:.1f}" y1="{y}" y2="{y}"/>'
            '<line class="half" x1="{:.1f}" x2="{:.1f}" y1="{y}" y2="{y}"/><circle cx="{:.1f}" cy="{y}" r="3.5"/></g>'
        ).format(
            tone,
            place(spread.q05),
            place(spread.q95),
            place(spread.q25),
            place(spread.q75),
            place(spread.q50),
            y=y,
        )

    drawn = bar(one.base, 11, 0) + (Markup() if one.proposal is None else bar(one.proposal, 25, 2))
    return Markup('<svg class="strip" viewBox="0 0 {} {}" aria-hidden="true">{}</svg>').format(
        WIDTH, HEIGHT, drawn
    )


LEARNED = Part("learned", "What the search learned", learned, ("status",))
