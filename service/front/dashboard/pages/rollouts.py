"""Every rollout of a job, dangerous or not: by how it ended, by phase and by f, each to be replayed."""

import math
from dataclasses import dataclass
from typing import Any
from urllib.parse import quote, urlencode

from starlette.requests import Request

from service.front.dashboard.link import FOR_GOOD_S, MOMENT_S
from service.front.dashboard.pages.failures import ENDS
from service.front.dashboard.pages.job import HEAD, estimate_of, job_of
from service.front.dashboard.site import Part, Site
from service.remote.api.objects import OVER

ROWS = 50  # on a page
ENDINGS = ("collision", "off-road", "reversing", "finished", "horizon", "error")
PHASES = {"estimate": "of the estimate", "train": "of the search"}
ORDERS = {"f": "the most dangerous first", "-f": "the least dangerous first", "record": "as they were drawn"}


@dataclass(frozen=True)
class Asked:
    """What the address says about the list; what it cannot mean is left out."""

    outcome: str
    phase: str
    low: str
    high: str
    by: str
    page: int

    @classmethod
    def of(cls, request: Request) -> "Asked":
        given = request.query_params
        page = given.get("page", "1")
        return cls(
            outcome=_one_of(given.get("outcome", ""), ENDINGS),
            phase=_one_of(given.get("phase", ""), PHASES),
            low=_number(given.get("low", "")),
            high=_number(given.get("high", "")),
            by=_one_of(given.get("by", ""), ORDERS) or "f",
            page=int(page) if page.isascii() and page.isdigit() and len(page) < 8 and int(page) else 1,
        )

    @property
    def wanted(self) -> dict[str, Any]:
        """As the API takes it."""
        values = {
            "outcome": self.outcome,
            "phase": self.phase,
            "low": self.low,
            "high": self.high,
            "by": self.by,
        }
        return {name: value for name, value in values.items() if value}

    @property
    def filtered(self) -> bool:
        return bool(self.outcome or self.phase or self.low or self.high)

    def address(self, job: str, page: int) -> str:
        """Of another page of the same list."""
        return f"/jobs/{quote(job, safe='')}/rollouts?{urlencode(self.wanted | {'page': page})}"


def _one_of(given: str, known: Any) -> str:
    return given if given in known else ""


def _number(text: str) -> str:
    """A number as it was given, "" for anything else."""
    try:
        return text.strip() if math.isfinite(float(text)) else ""
    except ValueError:
        return ""


async def rollouts(site: Site, request: Request) -> dict[str, Any]:
    """A page of the list."""
    job, asked = await job_of(site, request), Asked.of(request)
    over = job.status in OVER
    offset = (asked.page - 1) * ROWS
    found = await site.link.ask(
        ("listing", job.id, job.status, None if over else job.rollouts, asked),
        lambda client: client.listing(job.id, ROWS, offset=offset, **asked.wanted),
        FOR_GOOD_S if over else MOMENT_S,
    )
    rows = list(zip(found.phase, found.iteration, found.row, found.f, found.outcome, strict=True))
    return {
        "job": job,
        "asked": asked,
        "found": found,
        "first": offset + 1,
        "pages": max(math.ceil(found.found / ROWS), 1),
        "rows": [(*row, replay_address(job.id, *row[:3])) for row in rows],
        "estimate": await estimate_of(site, job),
        "ends": ENDS,
        "endings": ENDINGS,
        "phases": PHASES,
        "orders": ORDERS,
    }


def replay_address(job: str, phase: str, iteration: int, row: int) -> str:
    """Where a rollout is replayed."""
    return f"/jobs/{quote(job, safe='')}/rollouts/{row}?{urlencode({'phase': phase, 'iteration': iteration})}"


PARTS = (HEAD, Part("rollouts", "Rollouts", rollouts, ("status", "iteration")))
