"""Every part of a page drawn from answers as the API gives them, with names that would break one without escaping.

Long because it holds one answer of each kind, all of whose texts are hostile.
"""

from __future__ import annotations

import asyncio
import json
from typing import Any

import msgspec
import pytest
from starlette.requests import Request

from service.analysis.comparison import objects as C
from service.analysis.estimate_parts import EstimateWarning, Rollouts
from service.analysis.failures.playback import Playback, RoadLine, Track
from service.analysis.learned.objects import Behaviour, Learned, Parameter, Rate, Spread
from service.analysis.prevention import objects as V
from service.analysis.severity.objects import AtLeast, Injury, Likely, Severity
from service.evaluation.summary import Ending
from service.front.dashboard.live import Live, Rates
from service.front.dashboard.pages import (
    compare,
    failures,
    fleet,
    job,
    jobs,
    learned,
    risk,
    rollout,
    rollouts,
    submit,
    verdict,
)
from service.front.dashboard.pages import log as job_log
from service.front.dashboard.site import Part, Site
from service.remote.api import objects as O
from service.remote.client import NoAnswer, Refused

EVIL = '<img src=x onerror="alert(1)">'
CI = (1e-4, 3e-3)

JOB = O.Job(
    id="j1",
    number=1,
    label=EVIL,
    scenario="i80-10s",
    ego=EVIL,
    gamma=0.5,
    method="ce",
    options={"budget": 100},
    seed=1,
    priority=0,
    weight=1.0,
    at="2026-01-01T00:00:00+00:00",
    status="running",
    reason=EVIL,
    rollouts=40,
    leases=1,
    refusals={EVIL: EVIL},
)
OTHER = msgspec.structs.replace(JOB, id="j2", number=2, label="", status="done", rollouts=None)
ESTIMATE = O.Estimate(
    job="j1",
    status="running",
    p=1e-3,
    std_error=1e-4,
    ci=CI,
    confidence=0.95,
    gamma=0.5,
    method="ce",
    rollouts=Rollouts(40, 10, 30, 2),
    events=3,
    ess=2.5,
    max_weight_share=0.4,
    efficiency_vs_naive=3.0,
    variance_reliable=True,
    converged=False,
    warnings=(EstimateWarning(name="few-events", message=EVIL, remedy=EVIL),),
    scenario="i80-10s",
    ego=EVIL,
    seed=1,
    options={},
    tailroad="1",
    workers=0,
    wall_s=0.0,
    worker_s=4.0,
    sim_s=400.0,
    x_realtime_per_core=100.0,
)
SEARCH = O.SearchStep(
    number=0,
    iteration=0,
    rollouts=10,
    gamma_k=0.9,
    quantile=0.9,
    elites=1,
    ess=9.0,
    max_weight_share=0.2,
    events=1,
    infinite=0,
    failed=1,
    step=0.0,
    kl=0.1,
    summary={},
)
STEP = O.EstimateStep(
    number=1,
    iteration=0,
    rollouts=30,
    p=1e-3,
    std_error=1e-4,
    low=1e-4,
    high=3e-3,
    ess=2.5,
    max_weight_share=0.4,
    events=3,
    failed=0,
)
CURVE = O.Curve(
    job="j1",
    confidence=0.95,
    points=tuple(
        O.CurvePoint(gamma=g, p=p, std_error=None, ci=(0.0, 0.1), events=1, ess=None)
        for g, p in ((0.1, None), (0.2, 1e-5), (0.5, 1e-3))
    ),
)
LISTING = O.Listing(
    job="j1",
    total=90,
    found=60,
    phase=("estimate", EVIL),
    iteration=(0, 1),
    row=(7, 8),
    f=(0.2, None),
    outcome=("collision", EVIL),
)
COURSE = O.Course(
    job="j1",
    confidence=0.95,
    training=10,
    rollouts=(10, 20, 30),
    p=(None, 2e-3, 1e-3),
    low=(0.0, 1e-4, 1e-4),
    high=(1.0, 1e-2, 3e-3),
)
WORKER = O.Worker(
    id="w1",
    procs=2,
    egos=("lidar",),
    camera=True,
    gpu=False,
    host=EVIL,
    versions={},
    leases=1,
    chunks=3,
    rollouts=30,
    worker_s=9.0,
    quarantine="",
    now=(O.RunningChunk(job="j1", phase="train", iteration=0, rows=9, audit=True, for_s=1.5),),
)
SPREAD = Spread(mean=1.0, sd=1.0, q05=-1.0, q25=0.5, q50=1.0, q75=1.5, q95=3.0)
LEARNED = Learned(
    job="j1",
    iteration=3,
    source="proposal",
    confidence=0.95,
    effective=20.0,
    rollouts_run_again=(100, 90),
    parameters=(
        Parameter(
            name="v",
            vehicle=EVIL,
            kind="speed",
            unit="m/s",
            base=SPREAD,
            proposal=SPREAD,
            shift_sd=0.4,
            shift_sd_ci=(0.2, 0.6),
            sentence="the follower starts 20% faster",
        ),
        Parameter(
            name="fog",
            vehicle="",
            kind="weather",
            unit="",
            base=SPREAD,
            proposal=None,
            shift_sd=None,
            shift_sd_ci=None,
            sentence="",
        ),
    ),
    behaviours=(
        Behaviour(
            name="b",
            what="lane changes",
            unit="per km",
            base=Rate(value=1.0, low=0.5, high=1.5),
            proposal=Rate(value=None, low=None, high=None),
            sentence="",
        ),
    ),
    summary=("the follower starts 20% faster",),
    notes=(EVIL,),
)
SIDE = C.Side(
    name="lidar",
    run="r",
    scenario="s",
    ego=EVIL,
    method="naive",
    seed=1,
    rollouts=9,
    events=1,
    ess=1.0,
    p=1e-3,
    std_error=None,
    ci=CI,
    warnings=("few-events",),
)
DIFFERENCE = C.Difference(
    difference=-1e-4,
    difference_ci=(-1e-3, 1e-3),
    ratio=0.5,
    ratio_ci=(0.1, None),
    paired=True,
    how="normal",
    clear=False,
)
MODE_SIDE = C.ModeSide(events=1, p=1e-4, ci=CI)
LINE = C.Line(p=(None, 1e-3), low=(0.0, 1e-4), high=(1e-3, 1e-2))
COMPARISON = C.Comparison(
    gamma=0.5,
    confidence=0.95,
    sides=(SIDE, SIDE),
    pairs=(
        C.Pair(
            a=0,
            b=1,
            difference=DIFFERENCE,
            draws=C.Pairs(both=1, only_a=2, only_b=3, neither=4),
            modes=(
                C.ModeChange(
                    mode="m", name=EVIL, a=MODE_SIDE, b=MODE_SIDE, difference=DIFFERENCE, change="appeared"
                ),
            ),
            said=EVIL,
        ),
    ),
    curves=C.Curves(gamma=(0.1, 0.5), sides=(LINE, LINE)),
    notes=(EVIL,),
)
RISK = {
    "p": 1e-3,
    "ci": CI,
    "confidence": 0.95,
    "per_million_km": 9.0,
    "per_million_km_ci": [1.0, None],
    "km_between": 1e5,
    "km_between_ci": [1e4, None],
    "baseline": {"name": EVIL, "per_million_km": 1.1, "source": EVIL},
    "times_baseline": 8.0,
    "times_baseline_ci": [1.0, None],
    "summary": EVIL,
    "said": EVIL,
    "assumptions": [EVIL],
}
FAILURE = {
    "rank": 1,
    "iteration": 0,
    "row": 7,
    "noise_seed": "5",
    "f": 0.2,
    "f_again": 0.2,
    "same_to_the_bit": False,
    "outcome": "horizon",
    "error": None,
    "log_likelihood": 3.0,
    "starts_log_likelihood": 1.0,
    "weight": 1.0,
    "share": 0.5,
    "mode": EVIL,
    "kind": "rear-end",
    "other": None,
    "motion": None,
    "starts": {},
    "story": EVIL,
}
FAILURES = {
    "events": 3,
    "examined": 2,
    "p": 1e-3,
    "ci": CI,
    "gamma": 0.5,
    "failures": [FAILURE],
    "notes": [EVIL],
    "causes": [
        {"name": EVIL, "share": 0.5, "share_ci": [0.1, 0.9], "rank": 1, "story": EVIL},
    ],
    "modes": [
        {
            "mode": EVIL,
            "name": EVIL,
            "typical": EVIL,
            "events": 2,
            "share": 0.5,
            "share_ci": [0.1, 0.9],
            "p": 1e-3,
            "ci": CI,
            "agreement": 1.0,
            "example": FAILURE,
        }
    ],
}
PART = V.Part(events=1, share=0.5, share_ci=(0.1, 0.9), p=1e-3, ci=CI)
OF_MODE = V.OfMode(mode="m", name=EVIL, events=1, prevented=1, share=1.0, share_ci=(0.1, 1.0), preventable=PART,
                   unpreventable=PART)  # fmt: skip
ASKED = {"run": "r", "job": "j1", "scenario": "s", "ego": EVIL, "method": "ce", "gamma": 0.5, "confidence": 0.95,
         "order": "likelihood", "events": 2, "examined": 1, "notes": (EVIL,)}  # fmt: skip
PREVENTION = V.Prevention(
    **ASKED,
    p=1e-3,
    ci=CI,
    onset_ttc_s=None,
    bridged_s=0.5,
    references=(
        V.ByReference(
            reference=EVIL,
            says=EVIL,
            preventable=PART,
            unpreventable=PART,
            modes=(OF_MODE,),
            outcomes={EVIL: 1},
            failed=0,
        ),
    ),
    rollouts=(
        V.Prevented(
            rank=1,
            iteration=0,
            row=7,
            noise_seed="5",
            f=0.2,
            same_to_the_bit=True,
            outcome="horizon",
            share=0.5,
            mode="m",
            other=EVIL,
            onset=None,
            driven={EVIL: V.Driven(f=None, outcome="horizon", prevented=True)},
        ),
    ),
)
LIKELY = {"events": 1, "p": 1e-3, "ci": CI}
INJURY = Injury(**LIKELY, given_contact=0.1, given_contact_ci=(0.0, 0.2))
SEVERITY = Severity(
    **ASKED,
    contact=Likely(**LIKELY),
    at_least=(AtLeast(**LIKELY, delta_v_mps=5.0),),
    injury=INJURY,
    other_injury=INJURY,
    masses_kg={},
    contacts=(),
    assumptions=(EVIL,),
)
TRACK = Track(
    name=EVIL,
    role="ego",
    length_m=4.0,
    width_m=2.0,
    station_m=(0.0, 1.0),
    offset_m=(0.0, None),
    heading_rad=(0.0, 0.0),
    speed_mps=(9.0, None),
)
PLAYBACK = Playback(
    time_s=(0.0, 0.1),
    tracks=(TRACK,),
    measure="ttc",
    unit="s",
    measured=(None, 0.2),
    ttc_s=(None, 0.2),
    acceleration_mps2=(0.1, None),
    turn_rate_radps=(0.1, None),
    worst=1,
    gamma=0.5,
    outcome="horizon",
    road_station_m=(0.0, 9.0),
    road=(RoadLine(kind="edge", offset_m=(0.0, 0.0)),),
    ray_rad=(0.0,),
    ray_m=((None,), (3.0,)),
)
ROLLOUT = O.RolloutView(
    job="j1",
    phase="estimate",
    iteration=0,
    row=7,
    noise_seed="5",
    f=0.2,
    f_again=0.2,
    same_to_the_bit=True,
    dangerous=True,
    outcome="horizon",
    error=EVIL,
    motion=None,
    scenario="",
    trace=None,
    playback=PLAYBACK,
    camera=None,
)
EVENT = O.Event(
    job="j1", number=1, kind="quarantine", at="2026-01-01T00:00:00", body={"worker": EVIL, "reason": EVIL}
)

ANSWERS: dict[str, Any] = {
    "job": JOB,
    "jobs": [JOB, OTHER],
    "estimate": ESTIMATE,
    "iterations": [SEARCH, STEP],
    "curve": CURVE,
    "course": COURSE,
    "listing": LISTING,
    "log": [EVENT],
    "scenario": O.JobScenario(job="j1", name="s", listed=False, measure=None, noise_mode=None, text=EVIL),
    "scenarios": O.Scenarios(items=(), roads=(), weights=()),
    "workers": [WORKER, msgspec.structs.replace(WORKER, id="w2", quarantine=EVIL)],
    "tally": O.Tally(lost=1, copied=2, audited=3, wrong=1),
    "events": O.Events(items=(EVENT,), next=None),
    "learned": LEARNED,
    "comparison": COMPARISON,
    "risk": RISK,
    "prevention": PREVENTION,
    "severity": SEVERITY,
    "failures": FAILURES,
    "rollout": ROLLOUT,
}


class Canned:
    """A link whose answers are known."""

    here, reason = True, ""

    def __init__(self, answers: dict[str, Any]):
        self.answers = answers

    async def ask(self, key: Any, ask: Any, keep_s: float = 1.0) -> Any:
        found = self.answers[key if isinstance(key, str) else key[0]]
        if isinstance(found, Exception):
            raise found
        return found


def site(**answers: Any) -> Site:
    rates = Rates()
    return Site(Canned(ANSWERS | answers), Live(None, rates), rates)  # type: ignore[arg-type]


def drawn(at: Site, part: Part, query: str = "") -> tuple[int, str, float | None]:
    scope = {
        "type": "http",
        "method": "GET",
        "path": "/jobs/j1",
        "query_string": query.encode(),
        "headers": [],
        "path_params": {"job": "j1", "row": "7"},
    }
    return asyncio.run(at.draw_part(part, Request(scope)))


PARTS = {
    "jobs": (jobs.TABLE, ""),
    **{part.name: (part, "") for part in job.PARTS},
    "learned": (learned.LEARNED, ""),
    "failures": (failures.PARTS[1], ""),
    "log": (job_log.PARTS[1], ""),
    "forecast": (submit.FORECAST, "scenario=i80-10s&ego=%3Cimg&budget=20"),
    "rollouts": (rollouts.PARTS[1], "outcome=collision&low=x&page=2"),
    "risk": (risk.PARTS[1], ""),
    "prevention": (verdict.PARTS[1], ""),
    "severity": (verdict.PARTS[2], ""),
    "rollout": (rollout.PARTS[0], ""),
    "choice": (compare.PARTS[0], "jobs=j1"),
    "comparison": (compare.PARTS[1], "jobs=j1,j2"),
    **{part.name: (part, "") for part in fleet.FleetPage().parts},
}


@pytest.mark.parametrize("name", PARTS)
def test_a_part_is_drawn_and_nothing_that_was_told_becomes_a_tag(name):
    status, html, _ = drawn(site(), *PARTS[name])
    assert status == 200
    assert "<img" not in html
    assert name in ("search", "choice") or "&lt;img" in html or name == "course"


@pytest.mark.parametrize("name", PARTS)
def test_a_part_says_what_is_wrong_and_asks_again_where_that_helps(name):
    part, query = PARTS[name]
    for error, text, again in (
        (NoAnswer("nobody is there"), "nobody is there", True),
        (Refused(O.Problem("urn:x:no-such-key", "t", 404, "no key")), "update tailroad", False),
        (Refused(O.Problem("urn:x:working", "t", 503, "d", retry_after_s=1.0)), "Being computed", True),
    ):
        status, html, again_s = drawn(site(**dict.fromkeys(ANSWERS, error)), part, query)
        assert text in html
        assert (again_s is not None) is again
        assert status == {"nobody is there": 503, "update tailroad": 501, "Being computed": 202}[text]


def test_the_last_batch_stands_for_an_estimate_that_takes_long():
    class Slow(Canned):
        async def ask(self, key: Any, ask: Any, keep_s: float = 1.0) -> Any:
            if key[0] == "estimate":
                await asyncio.sleep(5.0)
            return await super().ask(key, ask, keep_s)

    at = site()
    at.link = Slow(ANSWERS)  # type: ignore[assignment]
    status, html, again_s = drawn(at, job.ANSWER)
    assert status == 200
    assert "p = 0.0010" in html
    assert again_s is not None


@pytest.mark.parametrize("part", [job.HEAD, job.ANSWER], ids=lambda part: part.name)
def test_while_a_record_is_replayed_the_page_shows_what_is_known(part):
    working = Refused(O.Problem("urn:x:working", "t", 202, "d", retry_after_s=1.0))
    done = msgspec.structs.replace(JOB, status="done", rollouts=None, options={})
    status, html, again_s = drawn(site(job=done, estimate=working), part)
    assert status == 200
    assert "Being computed" not in html
    assert again_s is not None
    assert part is job.HEAD or "95% interval" in html  # of a job that states no confidence, too


@pytest.mark.parametrize("name", PARTS)
def test_a_part_that_fails_says_so_in_its_place_and_not_what_the_error_was(name, caplog):
    part, query = PARTS[name]
    status, html, again_s = drawn(site(**dict.fromkeys(ANSWERS, KeyError("secret"))), part, query)
    assert (status, again_s) == (500, None)
    assert f"“{part.label}” cannot be shown" in html
    assert "Load the page again" in html
    assert len(html) < 800
    assert "<!doctype" not in html.lower()
    assert "secret" not in html
    assert "secret" in caplog.text


def test_the_fleet_of_a_service_that_does_not_count_chunks_is_shown_all_the_same():
    refused = Refused(O.Problem("urn:x:no-such-key", "t", 404, "no key"))
    status, html, _ = drawn(site(tally=refused), fleet.FleetPage().parts[0])
    assert status == 200
    assert "older than this dashboard" in html


def test_failures_are_those_of_a_mode_or_with_a_vehicle_where_that_is_asked():
    part = failures.PARTS[1]
    for query, listed in (
        ("", True),
        ("mode=x", False),
        ("with=background+traffic", True),
        ("with=env1", False),
    ):
        _, html, _ = drawn(site(), part, query)
        assert ('id="replay-1"' in html) is listed, query


def test_endings_have_no_p_where_the_estimate_is_but_a_bound():
    ending = Ending("collision", 2, 5.9e-100, (1e-101, 3e-99), ())
    shaky = msgspec.structs.replace(ESTIMATE, p=3.5e-95, ci=(0.0, 0.0173), endings=(ending,))
    _, html, _ = drawn(site(estimate=shaky), job.ANSWER)
    assert "p ≤ 0.0173" in html
    assert "5.9" not in html
    _, html, _ = drawn(site(estimate=msgspec.structs.replace(shaky, ci=CI, p=1e-3)), job.ANSWER)
    assert "5.9 × 10⁻¹⁰⁰" in html


def test_only_rows_of_naive_jobs_of_one_seed_are_the_same_draw():
    naive = msgspec.structs.replace(JOB, method="naive")
    assert rollout.same_draws(naive, msgspec.structs.replace(naive, id="j2", ego="other", gamma=0.1))
    assert not rollout.same_draws(naive, msgspec.structs.replace(naive, seed=2))
    assert not rollout.same_draws(JOB, JOB)


def test_what_charts_carry_for_the_script_is_json():
    _, html, _ = drawn(site(), job.COURSE)
    data = [piece.split('"')[0] for piece in html.split('data-chart="')[1:]]
    assert len(data) == 2
    for piece in data:
        json.loads(piece.replace("&#34;", '"').replace("&amp;", "&").replace("&#39;", "'"))
