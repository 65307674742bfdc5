"""Jobs beside each other: differences, ratios, curves, ways to fail that came and went."""

from collections.abc import Sequence
from typing import Any

from starlette.requests import Request

from service.analysis.comparison.objects import Comparison
from service.analysis.wording import level, quantity
from service.front.dashboard.charts import Chart, Mark, Series, figure
from service.front.dashboard.link import FOR_GOOD_S
from service.front.dashboard.pages.job import named
from service.front.dashboard.pages.job_charts import axis
from service.front.dashboard.pages.jobs import all_jobs
from service.front.dashboard.site import Part, Site
from service.remote.api.objects import OVER, Job

MOST = 6  # jobs beside each other
LISTED = 200  # to choose from, the newest
WHILE_RUNNING_S = 30.0
WIDE = 20.0


def chosen(request: Request) -> list[str]:
    """The jobs that the address names, each once."""
    names = ",".join(request.query_params.getlist("jobs")).split(",")
    return list(dict.fromkeys(name.strip() for name in names if name.strip()))[:MOST]


async def choice(site: Site, request: Request) -> dict[str, Any]:
    """What there is to choose from: the newest first, with the job that the address asks `with` at the top."""
    jobs = sorted(await all_jobs(site), key=lambda job: -job.number)
    names = chosen(request)
    first = [job for job in jobs if job.id in names]
    shown = first + [job for job in jobs if job.id not in names][:LISTED]
    return {"jobs": shown, "names": names, "total": len(jobs), "most": MOST,
            "gamma": request.query_params.get("gamma", "")[:40]}  # fmt: skip


async def comparison(site: Site, request: Request) -> dict[str, Any]:
    """The comparison of the chosen."""
    names = chosen(request)
    if len(names) < 2:
        return {"found": None, "jobs": [], "figures": [], "one": len(names) == 1}
    jobs = [await named(site, name) for name in names]
    gamma = _number(request.query_params.get("gamma", ""))
    found = await site.link.ask(
        ("comparison", tuple(names), gamma, tuple(job.status for job in jobs)),
        lambda client: client.comparison(names, gamma),
        FOR_GOOD_S if all(job.status in OVER for job in jobs) else WHILE_RUNNING_S,
    )
    return {"found": found, "jobs": jobs, "figures": [figure(curves_together(found, jobs))], "one": False}


def _number(text: str) -> float | None:
    try:
        return float(text) if text.strip() else None
    except ValueError:
        return None


def curves_together(found: Comparison, jobs: Sequence[Job]) -> Chart:
    """p against the threshold of all sides."""
    gammas = list(found.curves.gamma)
    series = tuple(
        Series(side_name(found, jobs, i), gammas, list(line.p), list(line.low), list(line.high), tone=1 + i % 4)
        for i, line in enumerate(found.curves.sides)
    )  # fmt: skip
    values = [p for line in found.curves.sides for p in line.p if p]
    return Chart(
        id="chart-together",
        title="Probability against threshold",
        shows=f"p of each against the threshold, with pointwise {level(found.confidence)} intervals.",
        x_label=axis("threshold γ", found.unit),
        y_label="p = P₀(f ≤ γ)",
        series=series,
        marks=(Mark("x", found.gamma, f"γ = {quantity(found.gamma, found.unit)}"),),
        y_log=bool(values) and max(values) > WIDE * min(values),
        note=f"Bands: {level(found.confidence)} intervals, pointwise.",
    )


def side_name(found: Comparison, jobs: Sequence[Job], i: int) -> str:
    """What a side is called: the job's label, or as the comparison has it."""
    return jobs[i].label or found.sides[i].name


PARTS = (
    Part("choice", "Jobs to compare", choice, ()),
    Part("comparison", "Comparison", comparison, ("status",)),
)
