"""A job: what is known of p, how it came about, what the search learned, what it cost, how to run it again."""

import asyncio
import shlex
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any
from urllib.parse import quote, urlencode

import msgspec
import numpy as np
from starlette.requests import Request

from service.analysis import wording
from service.front.dashboard.charts import figure
from service.front.dashboard.link import FOR_GOOD_S, MOMENT_S
from service.front.dashboard.pages import job_charts
from service.front.dashboard.pages.jobs import estimate_of, row_of
from service.front.dashboard.site import Part, Site
from service.remote.api.objects import (
    OVER,
    Course,
    Curve,
    Estimate,
    EstimateStep,
    Iterations,
    Job,
    JobScenario,
    Scenarios,
    SearchStep,
)
from service.remote.client import Client, Refused
from service.world.scenario.measures import span

ITERATIONS_PAGE = 1000
CURVE_STEPS = 41
PRELIMINARY_S = 0.25  # after which the last batch's record stands for the estimate
ALL_KINDS = ("status", "iteration", "progress", "note")


async def job_of(site: Site, request: Request) -> Job:
    return await named(site, request.path_params["job"])


async def named(site: Site, job: str) -> Job:
    return await site.link.ask(("job", job), lambda client: client.job(job))


async def head(site: Site, request: Request) -> dict[str, Any]:
    """State, progress and what may be told to it; of one that is over its rollouts as soon as they are known."""
    job = await job_of(site, request)
    if job.status not in OVER:
        return {"row": row_of(site, job, None), "job": job}
    estimate = await estimate_by_now(site, job)
    again_s = PRELIMINARY_S if estimate is None else None
    return {"row": row_of(site, job, estimate), "job": job, "again_s": again_s}


async def answer(site: Site, request: Request) -> dict[str, Any]:
    """p with its interval, and what bears on how far it can be relied on; until the service has replayed a long record
    for that, what the last batch came to."""
    job = await job_of(site, request)
    estimate = await estimate_by_now(site, job)
    if estimate is not None:
        counted = estimate.rollouts.total
        waiting = 0 if job.rollouts is None or estimate.rollouts.estimation == 0 else job.rollouts - counted
        return {
            "job": job,
            "estimate": estimate,
            "over": job.status in OVER,
            "last": None,
            "waiting": waiting,
        }
    steps = await steps_of(site, job)
    last = steps.estimate[-1] if steps.estimate and job.status != "failed" else None
    return {"job": job, "estimate": None, "over": job.status in OVER, "last": last, "waiting": 0,
            "again_s": PRELIMINARY_S}  # fmt: skip


async def estimate_by_now(site: Site, job: Job) -> Estimate | None:
    """The estimate; None while the service replays a long record for it."""
    asking = asyncio.ensure_future(estimate_of(site, job))
    asking.add_done_callback(lambda late: late.cancelled() or late.exception())
    done, _ = await asyncio.wait([asking], timeout=PRELIMINARY_S)
    try:
        return asking.result() if done else None
    except Refused as refused:
        if refused.kind != "working":
            raise
        return None


@dataclass(frozen=True)
class Steps:
    """What the batches came to: those of the search, and those of the estimate."""

    search: tuple[SearchStep, ...]
    estimate: tuple[EstimateStep, ...]

    @property
    def training(self) -> int:
        """Rollouts of the search."""
        return sum(step.rollouts for step in self.search)


async def steps_of(site: Site, job: Job) -> Steps:
    items = await site.link.ask(
        ("iterations", job.id, job.status), lambda client: _all_steps(client, job.id), keep_s(job)
    )
    return Steps(
        tuple(step for step in items if isinstance(step, SearchStep)),
        tuple(step for step in items if isinstance(step, EstimateStep)),
    )


async def curve_of(site: Site, job: Job, gammas: Sequence[float] | None = None) -> Curve:
    return await site.link.ask(
        ("curve", job.id, job.status, gammas),
        lambda client: client.curve(job.id, gammas or thresholds_about(job)),
        keep_s(job),
    )


async def course_of(site: Site, job: Job) -> Course:
    return await site.link.ask(
        ("course", job.id, job.status, None if job.status in OVER else job.rollouts),
        lambda client: client.course(job.id),
        keep_s(job),
    )


def thresholds_about(job: Job) -> list[float]:
    """Those that a curve is drawn over, the job's own among them."""
    low, high = span(job.unit, job.gamma)
    return sorted({*np.linspace(low, high, CURVE_STEPS).tolist(), job.gamma})


def _all_steps(client: Client, job: str) -> list[SearchStep | EstimateStep]:
    found: list[SearchStep | EstimateStep] = []
    after: int | None = -1
    while after is not None:
        page: Iterations = client.iterations(job, after, ITERATIONS_PAGE)
        found += page.items
        after = page.next
    return found


def keep_s(job: Job, while_running_s: float = MOMENT_S) -> float:
    """How long an answer about a job is kept: as long as that while it runs, for good when it is over."""
    return FOR_GOOD_S if job.status in OVER else while_running_s


async def course(site: Site, request: Request) -> dict[str, Any]:
    """The estimate against rollouts, and p against the threshold."""
    job = await job_of(site, request)
    steps, curve = await steps_of(site, job), await curve_of(site, job)
    estimate, came_in = await estimate_of(site, job), await course_of(site, job)
    charts = [
        job_charts.estimate_against_rollouts(job, came_in, steps.estimate),
        job_charts.probability_against_threshold(job, curve, estimate),
    ]
    return {
        "job": job,
        "figures": [figure(chart) for chart in charts],
        "thresholds": thresholds_of(job, curve),
    }


def thresholds_of(job: Job, curve: Curve) -> list[dict[str, Any]]:
    """What a slider over the thresholds tells at each that the rollouts say something on: words, and where those
    rollouts are listed."""
    found = []
    for point in curve.points:
        if point.p is None or not point.events:
            continue
        told, event = wording.told(point.p, point.ci), wording.quantity(round(point.gamma, 4), job.unit)
        sure = wording.level(curve.confidence)
        text = f"f ≤ {event}: p = {told.value}, {sure} interval {told.span}; {wording.count(point.events)} rollouts"
        address = f"/jobs/{quote(job.id, safe='')}/rollouts?{urlencode({'high': f'{point.gamma:.6g}'})}"
        found.append({"gamma": point.gamma, "said": text, "rollouts": address})
    return found


async def search(site: Site, request: Request) -> dict[str, Any]:
    """The search by iteration: thresholds, effective sample size, weights."""
    job = await job_of(site, request)
    steps = await steps_of(site, job)
    return {
        "job": job,
        "steps": steps,
        "over": job.status in OVER,
        "figures": [figure(chart) for chart in job_charts.of_the_search(job, steps.search, steps.estimate)],
    }


async def cost(site: Site, request: Request) -> dict[str, Any]:
    """What was spent, training apart; the settings; the commands that do it again."""
    job = await job_of(site, request)
    estimate = await estimate_of(site, job)
    scenario = await scenario_of(site, job)
    return {"job": job, "estimate": estimate, "command": command_of(job, scenario), "scenario": scenario}


async def scenario_of(site: Site, job: Job) -> JobScenario:
    return await site.link.ask(("scenario", job.id), lambda client: client.scenario(job.id), 60.0)


async def scenarios(site: Site) -> Scenarios:
    return await site.link.ask("scenarios", lambda client: client.scenarios(), 60.0)


def command_of(job: Job, scenario: JobScenario) -> str:
    """The command that submits the same job again, with the scenario's file where its name does not bring it back."""
    named = job.scenario if scenario.listed else f"{job.scenario}.toml"
    words = ["tailroad", "submit", named, "--ego", job.ego, "--gamma", f"{job.gamma!r}"]
    for option, value in (("--measure", scenario.measure), ("--noise-mode", scenario.noise_mode)):
        words += [option, value] if value is not None else []
    words += ["--method", job.method, "--seed", str(job.seed)]
    for name, value in sorted(job.options.items()):
        if value is None:
            continue
        if name in ("budget", "rel_error", "confidence"):
            words += [f"--{name.replace('_', '-')}", _text(value)]
        else:
            words += ["--option", f"{name}={_text(value)}"]
    words += ["--label", job.label] if job.label else []
    for option, number, usual in (("--priority", job.priority, 0), ("--weight", job.weight, 1.0)):
        words += [option, f"{number:g}"] if number != usual else []
    return shlex.join(words)


def _text(value: Any) -> str:
    return msgspec.json.encode(value).decode()


HEAD = Part("head", "State", head, ALL_KINDS)
ANSWER = Part("answer", "Estimate", answer, ALL_KINDS)
COURSE = Part("course", "Estimate against rollouts and thresholds", course, ALL_KINDS)
SEARCH = Part("search", "Search by iteration", search, ("status", "iteration"))
COST = Part("cost", "Cost and settings", cost, ("status", "iteration"))
PARTS = (HEAD, ANSWER, COURSE, SEARCH, COST)
