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
from service.remote.client import Client, NoAnswer, Refused

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
    "label": ("label", lambda row: row.job.label.lower() or None, False),
    "scenario": ("scenario", lambda row: row.job.scenario, False),
    "ego": ("ego", lambda row: row.job.ego, False),
    "method": ("method", lambda row: row.job.method, False),
    "gamma": ("threshold", lambda row: row.job.gamma, False),
    "p": ("p", lambda row: None if row.estimate is None else row.estimate.p, True),
    "rollouts": ("rollouts", lambda row: row.rollouts, True),
    "pace": ("pace", lambda row: row.per_s, True),
    "cost": ("cost", lambda row: None if row.estimate is None else row.estimate.worker_s, True),
}
BY_ESTIMATE = ("p", "cost", "rollouts")  # sorted by what all estimates come to
MOST_SORTED = 200  # jobs, the newest, whose estimates are asked for to sort by them


@dataclass(frozen=True)
class Asked:
    """What the address says about the list."""

    search: str = ""
    state: str = ""
    scenario: str = ""
    ego: str = ""
    method: str = ""
    tag: str = ""
    archived: bool = False
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
            tag=given.get("tag", ""),
            archived=given.get("archived") == "1",
            sort=sort if sort in SORTS else "newest",
            turned=given.get("turned") == "1",
            page=int(page) if page.isascii() and page.isdigit() and len(page) < 8 and int(page) else 1,
        )

    def address(self, **changes: Any) -> str:
        """The address of the same list with something changed."""
        values = {name: getattr(self, name) for name in self.__dataclass_fields__} | changes
        values |= {name: "1" if values[name] else "" for name in ("turned", "archived")}
        query = {
            k: v
            for k, v in values.items()
            if v and not (k == "sort" and v == "newest") and (k, v) != ("page", 1)
        }
        return "/?" + urlencode(query) if query else "/"

    @property
    def filtered(self) -> bool:
        return bool(self.search or self.state or self.scenario or self.ego or self.method or self.tag)

    def by(self, sort: str) -> str:
        """The address of the same list sorted by a column, or by the same the other way round."""
        return self.address(sort=sort, turned=not self.turned if sort == self.sort else False, page=1)

    def fits(self, job: Job) -> bool:
        for name, value in (("status", self.state), ("scenario", self.scenario), ("ego", self.ego),
                            ("method", self.method)):  # fmt: skip
            if value and getattr(job, name) != value:
                return False
        if (self.tag and self.tag not in job.tags) or (job.archived and not self.archived):
            return False
        said = (job.id, job.label, job.scenario, job.ego, job.method, job.status, job.note, *job.tags)
        text = " ".join(said).lower()
        return all(word in text for word in self.search.lower().split())


async def all_jobs(site: Site) -> list[Job]:
    return await site.link.ask("jobs", site.book.read)


async def table(site: Site, request: Request) -> dict[str, Any]:
    """A page of the list."""
    asked, jobs = Asked.of(request), await all_jobs(site)
    fitting = [job for job in jobs if asked.fits(job)]
    newest = sorted(fitting, key=lambda job: -job.number)[:MOST_SORTED] if asked.sort in BY_ESTIMATE else []
    first = await estimates_of(site, newest)
    rows = in_order([row_of(site, job, first.get(job.id)) for job in fitting], asked)
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
        "again_s": AGAIN_S if len(estimates) < len(shown) or len(first) < len(newest) else None,
        "put_away": sum(job.archived for job in jobs),
        "sorts": SORTS,
        "choices": {
            "state": STATUSES,
            "scenario": sorted({job.scenario for job in jobs}),
            "ego": sorted({job.ego for job in jobs}),
            "method": sorted({job.method for job in jobs}),
            "tag": sorted({tag for job in jobs for tag in job.tags}),
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


def orders_on(order: str, tag: str) -> Callable[..., Any] | None:
    """What an order on chosen jobs asks of the service for each `job`; None for one that there is not."""
    tag = tag.replace(",", " ").strip()[:40]

    def tagged(client: Client, job: Job) -> None:
        client.note(job.id, tags=[*job.tags, tag])

    known: dict[str, Callable[..., Any]] = {
        "cancel": lambda client, job: client.cancel(job.id),
        "archive": lambda client, job: client.note(job.id, archived=True),
        "bring-back": lambda client, job: client.note(job.id, archived=False),
        "tag": tagged if tag else lambda client, job: None,
        "untag": lambda client, job: client.note(job.id, tags=[one for one in job.tags if one != tag]),
    }
    return known.get(order)


TABLE = Part("jobs", "Jobs", table, ("status", "iteration", "progress", "note"), every_s=None)
