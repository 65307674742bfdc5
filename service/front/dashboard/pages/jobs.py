"""The list of jobs: filtered, sorted, searched, a page of it with what each came to."""

import asyncio
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any
from urllib.parse import urlencode

from starlette.requests import Request

from service.front.dashboard.link import FOR_GOOD_S, MOMENT_S
from service.front.dashboard.site import Part, Site
from service.remote.api.objects import OVER, STATUSES, Estimate, Job
from service.remote.client import NoAnswer, Refused

ROWS = 25  # on a page
ESTIMATE_S = 2.0  # that the table of a page waits for estimates that are not at hand
AGAIN_S = 1.0  # and after which those that were late are asked for again
LONGEST_SEARCH = 200


@dataclass(frozen=True)
class Row:
    """A job as the table shows it. estimate: None where it is not there (yet)."""

    job: Job
    estimate: Estimate | None
    rollouts: int | None
    budget: int | None
    per_s: float | None

    @property
    def over(self) -> bool:
        return self.job.status in OVER

    @property
    def share(self) -> float | None:
        """Of the budget that is used."""
        if self.rollouts is None or not self.budget:
            return None
        return min(self.rollouts / self.budget, 1.0)

    @property
    def left_s(self) -> float | None:
        """Until the budget is used, at the present pace."""
        if self.job.status != "running" or not self.per_s or self.rollouts is None or not self.budget:
            return None
        return max(self.budget - self.rollouts, 0) / self.per_s


# What the table can be sorted by: its name in addresses, its words, the key (None: goes last), whether high goes first.
Key = Callable[[Row], Any]
SORTS: dict[str, tuple[str, Key, bool]] = {
    "newest": ("submitted", lambda row: row.job.number, True),
    "state": ("state", lambda row: STATUSES.index(row.job.status), False),
    "scenario": ("scenario", lambda row: row.job.scenario, False),
    "ego": ("ego", lambda row: row.job.ego, False),
    "method": ("method", lambda row: row.job.method, False),
    "gamma": ("threshold", lambda row: row.job.gamma, False),
    "rollouts": ("rollouts", lambda row: row.rollouts, True),
}


@dataclass(frozen=True)
class Asked:
    """What the address says about the list."""

    search: str = ""
    state: str = ""
    scenario: str = ""
    ego: str = ""
    method: str = ""
    sort: str = "newest"
    turned: bool = False
    page: int = 1

    @classmethod
    def of(cls, request: Request) -> "Asked":
        """From the address; what it cannot mean is left out."""
        given = request.query_params
        sort, page = given.get("sort", "newest"), given.get("page", "1")
        return cls(
            search=given.get("search", "")[:LONGEST_SEARCH].strip(),
            state=given.get("state", ""),
            scenario=given.get("scenario", ""),
            ego=given.get("ego", ""),
            method=given.get("method", ""),
            sort=sort if sort in SORTS else "newest",
            turned=given.get("turned") == "1",
            page=int(page) if page.isascii() and page.isdigit() and len(page) < 8 and int(page) else 1,
        )

    def address(self, **changes: Any) -> str:
        """The address of the same list with something changed."""
        values = {name: getattr(self, name) for name in self.__dataclass_fields__} | changes
        values["turned"] = "1" if values["turned"] else ""
        query = {
            k: v
            for k, v in values.items()
            if v and not (k == "sort" and v == "newest") and (k, v) != ("page", 1)
        }
        return "/?" + urlencode(query) if query else "/"

    @property
    def filtered(self) -> bool:
        return bool(self.search or self.state or self.scenario or self.ego or self.method)

    def fits(self, job: Job) -> bool:
        for name, value in (("status", self.state), ("scenario", self.scenario), ("ego", self.ego),
                            ("method", self.method)):  # fmt: skip
            if value and getattr(job, name) != value:
                return False
        text = " ".join((job.id, job.label, job.scenario, job.ego, job.method, job.status)).lower()
        return all(word in text for word in self.search.lower().split())


async def all_jobs(site: Site) -> list[Job]:
    return await site.link.ask("jobs", site.book.read)


async def table(site: Site, request: Request) -> dict[str, Any]:
    """A page of the list."""
    asked, jobs = Asked.of(request), await all_jobs(site)
    rows = in_order([row_of(site, job, None) for job in jobs if asked.fits(job)], asked)
    pages = max(math.ceil(len(rows) / ROWS), 1)
    page = min(asked.page, pages)
    shown = rows[(page - 1) * ROWS : page * ROWS]
    estimates = await estimates_of(site, [row.job for row in shown])
    return {
        "rows": [row_of(site, row.job, estimates.get(row.job.id)) for row in shown],
        "found": len(rows),
        "total": len(jobs),
        "first": (page - 1) * ROWS + 1,
        "page": page,
        "pages": pages,
        "asked": asked,
        "again_s": AGAIN_S if len(estimates) < len(shown) else None,
        "sorts": SORTS,
        "choices": {
            "state": STATUSES,
            "scenario": sorted({job.scenario for job in jobs}),
            "ego": sorted({job.ego for job in jobs}),
            "method": sorted({job.method for job in jobs}),
        },
    }


def in_order(rows: Sequence[Row], asked: Asked) -> list[Row]:
    """Rows by what was asked for; those that have none of it last, those alike by their number."""
    _, key, high_first = SORTS[asked.sort]
    known = [row for row in rows if key(row) is not None]
    known.sort(key=lambda row: -row.job.number)
    known.sort(key=key, reverse=high_first is not asked.turned)
    return known + [row for row in rows if key(row) is None]


def row_of(site: Site, job: Job, estimate: Estimate | None) -> Row:
    rollouts = job.rollouts
    if rollouts is None and estimate is not None:
        rollouts = estimate.rollouts.total
    budget = job.options.get("budget")
    per_s = site.rates.of(job.id) if job.status == "running" else None
    return Row(job, estimate, rollouts, budget if isinstance(budget, int) else None, per_s)


async def estimates_of(site: Site, jobs: Sequence[Job]) -> dict[str, Estimate]:
    """Those of the jobs' estimates that there are by now."""
    asking = {job.id: asyncio.ensure_future(estimate_of(site, job)) for job in jobs}
    if asking:
        await asyncio.wait(asking.values(), timeout=ESTIMATE_S)
    found = {}
    for job, task in asking.items():
        task.add_done_callback(lambda late: late.cancelled() or late.exception())
        if task.done() and task.exception() is None:
            found[job] = task.result()
        elif task.done() and not isinstance(task.exception(), Refused | NoAnswer):
            raise task.exception()  # type: ignore[misc]
    return found


async def estimate_of(site: Site, job: Job) -> Estimate:
    over = job.status in OVER
    return await site.link.ask(
        ("estimate", job.id, job.status, None if over else job.rollouts),
        lambda client: client.estimate(job.id),
        FOR_GOOD_S if over else 2 * MOMENT_S,
    )


TABLE = Part("jobs", "Jobs", table, ("status", "iteration", "progress"), every_s=None)
