"""The report of a run: its facts, its page and its pictures.

Long because one run, made once, is read by all of the tests.
"""

import base64
import contextlib
import dataclasses
import functools
import hashlib
import json
import re
from datetime import UTC, datetime
from html.parser import HTMLParser
from pathlib import Path

import msgspec
import numpy as np
import pytest

import ce
from policies.drivers import load_drivers, save_drivers
from policies.layout import HEAD_SIZE, HIDDEN_1, HIDDEN_2, OBSERVATION_SIZE
from service.analysis import wording
from service.analysis.failures.playback import Playback
from service.analysis.report import figures, words, write_report
from service.analysis.report.dangerous import Findings
from service.analysis.report.facts import facts_of
from service.analysis.report.objects import Report
from service.errors import StoreError
from service.evaluation.evaluate import evaluate
from service.evaluation.job import Job, Problem, make_job
from service.evaluation.record import replay
from service.evaluation.store import FAILED, Chunk, RunDirectory
from service.world.scenario import Scenario, load_scenario
from tests.service.conftest import PATIENCE_MS

NOW = datetime(2030, 1, 2, 3, 4, 5, tzinfo=UTC)
VOID = {"meta", "img", "br", "link", "input", "hr"}
NAIVE = {"budget": 3000, "batch_size": 1500}
CE = {
    "iterations": 3,
    "samples_per_iteration": 400,
    "estimation_rollouts": 1000,
    "rho": 0.1,
    "mean_box": None,
    "batch_size": 500,
}


class Page(HTMLParser):
    """Checks that tags close in order, and keeps what the tests ask for."""

    def __init__(self, html: str):
        super().__init__()
        self.open: list[str] = []
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.text: list[str] = []
        self.data: list[float] = []
        self.feed(html)
        self.close()
        assert self.open == []
        self.words = " ".join(" ".join(self.text).split())

    def handle_starttag(self, tag, attributes):
        self.tags.append((tag, dict(attributes)))
        if tag == "data" and dict(attributes)["value"]:
            self.data.append(float(dict(attributes)["value"] or "nan"))
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag, f"</{tag}> does not close what is open"

    def handle_data(self, data):
        if not self.open or self.open[-1] not in ("style", "script"):
            self.text.append(data)

    def all(self, tag: str) -> list[dict[str, str | None]]:
        return [attributes for name, attributes in self.tags if name == tag]


@pytest.fixture(scope="module", autouse=True)
def read_weights_once():
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("service.evaluation.job.load_drivers", functools.cache(load_drivers))
        yield


@pytest.fixture(scope="module")
def weights(tmp_path_factory) -> Path:
    """Driver weights that were never trained."""
    rng = np.random.default_rng(0)
    shapes = {
        "w1": (OBSERVATION_SIZE, HIDDEN_1),
        "b1": (HIDDEN_1,),
        "w2": (HIDDEN_1, HIDDEN_2),
        "b2": (HIDDEN_2,),
        "mu0": (HEAD_SIZE,),
    }
    arrays = {name: 0.01 * rng.standard_normal(shape) for name, shape in shapes.items()}
    arrays |= {"action_scale": np.array([1.0, 0.05]), "sigma0": 1e-4 * np.eye(HEAD_SIZE)}
    path = tmp_path_factory.mktemp("weights") / "made-up.safetensors"
    return save_drivers(path, arrays, {})


@pytest.fixture(scope="module")
def scenario(weights) -> Scenario:
    found = load_scenario("i80-paper-10s")
    return msgspec.structs.replace(
        found, drivers=msgspec.structs.replace(found.drivers, weights=str(weights))
    )


def made_up_f(x: np.ndarray) -> np.ndarray:
    """f of rollouts x (n, d), lower the faster the ego is and the closer its neighbour in lane 2 starts."""
    gap_m = np.abs(x[:, 8] - x[:, 0])
    return 0.1 + 0.05 * gap_m + 0.3 * (20.0 - x[:, 3])


class Interrupted(Exception):
    pass


def fill(store: RunDirectory, job: Job, chunks: int | None = None, errors: dict | None = None) -> None:
    """Record a job's rollouts with made-up values; stop for good after so many chunks."""
    problem = Problem(job)
    left = [10**9 if chunks is None else chunks]

    def run_batch(batch: ce.Batch) -> np.ndarray:
        f = made_up_f(batch.x)
        for row, _ in (errors or {}).items():
            if batch.phase == "estimate" and batch.start <= row < batch.stop:
                f[row - batch.start] = np.nan
        for i in range(0, f.size, 250):
            if left[0] == 0:
                raise Interrupted
            left[0] -= 1
            part = f[i : i + 250]
            lost = {
                r: (errors or {})[batch.start + i + r]
                for r in range(part.size)
                if batch.phase == "estimate" and batch.start + i + r in (errors or {})
            }
            codes = np.where(part < 0.9, 2, 0).astype(np.uint8)
            codes[list(lost)] = FAILED
            steps = np.full(part.size, 100, np.int32)
            first = batch.start + i
            chunk = Chunk(first, first + part.size, part, codes, steps, lost, 0.5)
            store.append(job.id, batch.phase, batch.iteration, chunk)
        return f

    with contextlib.suppress(Interrupted):
        evaluate(problem.algorithm, problem.stream_seed, run_batch)


def jobs_of(scenario: Scenario, gamma: float = 0.9) -> tuple[Job, Job]:
    return (
        make_job(scenario, "idm", gamma, "naive", 1, NAIVE),
        make_job(scenario, "idm", gamma, "ce", 1, CE),
    )


@pytest.fixture(scope="module")
def run(scenario, tmp_path_factory):
    """A finished run of both methods, its page and its facts."""
    path = tmp_path_factory.mktemp("runs") / "both"
    with RunDirectory.create(path, jobs_of(scenario)) as store:
        for job in store.jobs:
            fill(store, job)
        page = write_report(store, drawn=0, now=NOW)
    html = page.read_text(encoding="utf-8")
    return path, html, Page(html), json.loads((path / "report.json").read_text(encoding="utf-8"))


def test_the_page_says_the_estimates_of_the_json(run):
    path, _, page, facts = run
    with RunDirectory.open(path) as store:
        estimates = {job.id: replay(store, job).estimate for job in store.jobs}
    for job in facts["jobs"]:
        estimate = estimates[job["id"]]
        assert (job["p"], job["std_error"], tuple(job["ci"])) == (estimate.p, estimate.std_error, estimate.ci)
        for value in (job["p"], job["std_error"], *job["ci"], job["ess"], job["rollouts"]["total"]):
            assert value in page.data
        assert wording.told(job["p"], job["ci"]).value in page.words
    head = facts["headline"]
    assert f"p = {wording.told(head['p'], head['ci']).value}" in page.words
    assert head["answer_interval"] in page.words


def test_no_efficiency_is_claimed_from_a_variance_that_says_nothing(run):
    _, _, page, facts = run
    (search,) = [job for job in facts["jobs"] if job["method"] == "ce"]
    assert not search["variance_reliable"]
    assert page.words.count("not known: see warnings") == 2
    assert search["against_naive"]["efficiency"] not in page.data


def test_replaying_a_record_gives_the_estimate_that_ran(run, scenario):
    path, _, _, _ = run
    with RunDirectory.open(path) as store:
        for job in store.jobs:
            problem = Problem(job)
            direct = evaluate(problem.algorithm, problem.stream_seed, lambda batch: made_up_f(batch.x))
            replayed = replay(store, job)
            assert replayed.estimate.p == direct.p
            assert replayed.estimate.ci == direct.ci
            assert replayed.recorded == direct.rollouts
            assert replayed.sim_s == pytest.approx(10.0 * direct.rollouts)


def test_the_page_needs_nothing_from_outside(run):
    _, html, page, _ = run
    assert not re.search(r"https?://|//[a-z]", html)
    for tag, attributes in page.tags:
        for name in ("src", "href", "srcset", "action"):
            value = attributes.get(name)
            assert value is None or value.startswith(("#", "data:image/")), (tag, name)
        assert tag not in ("script", "iframe", "link", "object", "form")
    assert "@import" not in html
    assert "url(" not in html


def test_the_page_is_accessible(run):
    _, _, page, _ = run
    assert page.all("html")[0]["lang"] == "en"
    assert {"header", "main", "nav", "footer"} <= {tag for tag, _ in page.tags}
    pictures = page.all("img")
    assert len(pictures) == 15  # four of the run, two of the search, five and four of what was learned
    assert all(len(picture["alt"] or "") > 30 for picture in pictures)
    assert all(th.get("scope") in ("row", "col") for th in page.all("th"))
    ids = [attributes["id"] for _, attributes in page.tags if "id" in attributes]
    assert len(ids) == len(set(ids))
    targets = {(a["href"] or "")[1:] for a in page.all("a")}
    assert targets <= set(ids)


def test_warnings_of_the_estimates_are_shown_with_their_remedy(run):
    _, _, page, facts = run
    warnings = [warning for job in facts["jobs"] for warning in job["warnings"]]
    assert warnings
    for warning in warnings:
        assert warning["message"] in page.words
        assert warning["remedy"] in page.words


def test_an_estimate_without_events_is_said_as_a_bound():
    none = {"p": 0.0, "ci": [0.0, 0.0074], "confidence": 0.95, "events": 0, "rollouts": {"estimation": 500}}
    assert words.answer(none) == (
        "No such event in 500 rollouts.",
        "95% interval: at most 0.0074, or one in 140 rollouts.",
    )


@pytest.mark.parametrize("chunks", [0, 1, 5, 7], ids="{} chunks".format)
def test_an_unfinished_job_counts_as_far_as_its_record_goes(scenario, tmp_path, chunks):
    job = jobs_of(scenario)[1]
    with RunDirectory.create(tmp_path / "half", (job,)) as store:
        fill(store, job, chunks=chunks)
        (facts,) = facts_of(store.path.name, [replay(store, job)], Findings(), NOW)["jobs"]
    # the first rows of the estimation batch count before it is complete
    estimating = 250 if chunks == 7 else 0
    assert not facts["finished"]
    assert (facts["p"] is not None) == bool(estimating)
    assert len(facts["training"]) == chunks // 2
    assert facts["progress"]["counted"] == chunks // 2 * 400 + estimating
    assert facts["progress"]["recorded"] == sum([250, 150, 250, 150, 250, 150, 250][:chunks])


def test_an_unfinished_run_has_a_page(scenario, tmp_path):
    jobs = jobs_of(scenario)
    with RunDirectory.create(tmp_path / "half", jobs) as store:
        fill(store, jobs[1], chunks=5)
        page = Page(write_report(store, drawn=0, now=NOW).read_text(encoding="utf-8"))
    assert "p is not known yet" in page.words
    assert "Unfinished: naive Monte Carlo" in page.words
    assert "Unfinished: cross-entropy method. 800 of at most 2,200 rollouts" in page.words
    assert "250 more are on record" in page.words
    assert "--resume half" in page.words


def test_what_users_write_is_escaped_and_failures_are_listed(scenario, tmp_path):
    hostile = "<script>alert('x')</script> & \"quotes\" $\\frac{ </style> {{ 7 * 7 }}"
    reason = "EgoError: <img src=x onerror=alert(1)>"
    renamed = [
        msgspec.structs.replace(v, name=f"<b>{v.name}</b>$_{{") if i == 1 else v
        for i, v in enumerate(scenario.vehicles)
    ]
    changed = msgspec.structs.replace(scenario, description=hostile, name="a<i>b", vehicles=tuple(renamed))
    job = jobs_of(changed)[1]
    with RunDirectory.create(tmp_path / "hostile", (job,)) as store:
        fill(store, job, errors={7: reason, 702: "the worker process died"})
        html = write_report(store, drawn=0, now=NOW).read_text(encoding="utf-8")
        record = replay(store, job)
    page = Page(html)
    assert not re.search("<script|<img src=x|<b>|<i>", html)
    assert hostile in "".join(page.text)
    assert reason in page.words
    listed = json.loads((tmp_path / "hostile" / "report.json").read_text())["jobs"][0]["failures"]
    assert listed["total"] == 2
    proposal = record.problem.base.with_parameters(record.parameters["estimate", 0])
    _, noise_seeds = ce.draw(proposal, record.problem.stream_seed, "estimate", 0, 0, 1000)
    assert [(x["row"], x["noise_seed"]) for x in listed["listed"]] == [
        (7, str(noise_seeds[7])),
        (702, str(noise_seeds[702])),
    ]
    assert str(noise_seeds[702]) in page.words


def test_the_report_is_the_same_each_time(run):
    path, html, _, facts = run
    with RunDirectory.open(path) as store:
        records = [replay(store, job) for job in store.jobs]
    again = facts_of(path.name, records, Findings(), NOW)
    assert again == facts
    assert figures.outcomes(again["jobs"]).source in html


def test_methods_that_cannot_both_be_right_are_named(run):
    path, _, _, _ = run
    with RunDirectory.open(path) as store:
        naive, search = (replay(store, job) for job in store.jobs)
    assert facts_of(path.name, [naive, search], Findings(), NOW)["disagreement"] is None
    wrong = dataclasses.replace(naive.estimate, f=np.zeros(3000))
    odd = dataclasses.replace(naive, estimate=wrong)
    assert "no value in common" in facts_of(path.name, [odd, search], Findings(), NOW)["disagreement"]


def test_a_folder_that_cannot_be_written_is_an_error_that_says_so(run, tmp_path):
    path, _, _, _ = run
    blocked = tmp_path / "file"
    blocked.write_text("")
    with RunDirectory.open(path) as store, pytest.raises(StoreError, match="cannot write the report"):
        write_report(store, blocked, drawn=0, now=NOW)


@pytest.mark.parametrize(
    ("value", "said"),
    [
        (0.0, "0"),
        (None, "not known"),
        (float("inf"), "∞"),
        (0.47361, "0.474"),
        (1.234e-5, "1.23 × 10⁻⁵"),
        (0.00999999, "0.0100"),
        (84321.0, "84,300"),
        (1.0, "1.00"),
    ],
)
def test_numbers_have_sensible_digits(value, said):
    assert wording.significant(value) == said


def test_probabilities_in_words():
    assert wording.one_in(1.19e-5) == "one in 84,000"
    assert wording.one_in(0.474) == "47 in 100"
    assert wording.duration(7322) == "2 h 2 min"


def test_what_is_written_is_what_the_schema_says(run):
    _, _, _, facts = run
    told = msgspec.convert(facts, Report)
    assert json.loads(msgspec.json.encode(told)) == facts
    assert told.learned["naive"].source == "dangerous rollouts"
    assert told.learned["ce"].source == "proposal"


def test_what_was_learned_is_said(run):
    _, _, page, facts = run
    assert any("the ego starts" in sentence for sentence in facts["learned"]["naive"]["summary"])
    for learned in facts["learned"].values():
        for said in (*learned["summary"], *learned["notes"]):
            assert said[1:] in page.words


@pytest.fixture(scope="module")
def real(scenario, tmp_path_factory):
    """Three real rollouts, run again with SUMO and drawn: the report's page and its facts."""
    named = [
        msgspec.structs.replace(v, name="</script><b>" if i == 1 else v.name)
        for i, v in enumerate(scenario.vehicles)
    ]
    hostile = msgspec.structs.replace(scenario, vehicles=tuple(named))
    job = make_job(hostile, "idm", 50.0, "naive", 1, {"budget": 3, "batch_size": 3})
    with RunDirectory.create(tmp_path_factory.mktemp("real") / "run", (job,)) as store:
        record_three(store, job)
        page = write_report(store, drawn=3, now=NOW)
    return page, json.loads(page.with_suffix(".json").read_text(encoding="utf-8"))


def test_real_rollouts_are_run_again_and_drawn(real):
    """f of each rollout comes out as recorded, except of the one whose record is wrong."""
    page, told = Page(real[0].read_text(encoding="utf-8")), real[1]["dangerous"]
    assert len(told) == 3
    assert sorted(d["row"] for d in told if not d["same_to_the_bit"]) == [1]
    assert "1 of 3 did not come out the same" in page.words
    assert len([p for p in page.all("img") if "the smallest time to collision" in (p["alt"] or "")]) == 3


def test_replays_are_in_the_page_and_no_other_script_may_run(real):
    html = real[0].read_text(encoding="utf-8")
    page = Page(html)  # a vehicle's name closes no script
    data, (player,) = (
        [(a, body) for a, body in scripts(html) if (a == ' type="application/json"') is kind]
        for kind in (True, False)
    )
    digest = base64.b64encode(hashlib.sha256(player[1].encode()).digest()).decode()
    assert f"script-src 'sha256-{digest}'" in html
    assert "default-src 'none'" in html
    assert (
        len(data) == len(page.all("div")) - len([d for d in page.all("div") if "data-rollout" not in d]) == 3
    )
    for (_, body), told in zip(data, real[1]["dangerous"], strict=True):
        played = msgspec.json.decode(body, type=Playback)
        assert played.tracks[1].name == "</script><b>"
        assert played.measured[played.worst] == pytest.approx(told["f_again"], abs=1e-3)
    assert len(html) < 3_000_000


def test_replays_play_in_a_browser_from_the_file_alone(real, browser):
    from playwright.sync_api import expect

    page = browser.new_page(viewport={"width": 390, "height": 800}, offline=True)
    page.set_default_timeout(4.0 * PATIENCE_MS)
    wrong: list[str] = []
    page.on("pageerror", lambda error: wrong.append(str(error)))
    page.on("console", lambda message: wrong.append(message.text) if message.type == "error" else None)
    page.goto(real[0].as_uri())
    player = page.locator(".player").first
    told, slider, button = player.locator("output"), player.locator("input"), player.locator("button")
    worst = told.inner_text()
    slider.fill("0")
    assert told.inner_text().startswith("0.0 s, ttc")
    button.click()
    expect(slider).not_to_have_value("0")
    slider.fill("2")  # whoever scrubs stops it
    assert button.inner_text() == "Play"
    assert told.inner_text().startswith("0.2 s, ttc")
    assert worst.split(",")[0] == f"{real[1]['dangerous'][0]['worst_at_s']:.1f} s"
    assert page.evaluate("document.documentElement.scrollWidth") <= 390
    drawn = "c => new Set(c.getContext('2d').getImageData(0, 0, c.width, c.height).data).size"
    assert player.locator("canvas").first.evaluate(drawn) > 10
    page.emulate_media(media="print")
    assert not player.is_visible()
    assert wrong == []
    page.close()


def scripts(html: str) -> list[tuple[str, str]]:
    """Attributes (ids left out) and contents of the page's scripts."""
    return [
        (re.sub(' id="[^"]*"', "", found[1]), found[2])
        for found in re.finditer("<script([^>]*)>(.*?)</script>", html, re.S)
    ]


def record_three(store: RunDirectory, job: Job) -> None:
    """Three real rollouts, the second with an f that is off by the last bit."""
    problem = Problem(job)
    x, noise_seeds = ce.draw(problem.base, problem.stream_seed, "estimate", 0, 0, 3)
    with problem.simulator() as simulator:
        rollouts = [simulator.run(row, int(seed)) for row, seed in zip(x, noise_seeds, strict=True)]
    f = np.array([r.f for r in rollouts])
    f[~np.isfinite(f)] = 1.0
    f[1] = np.nextafter(f[1], 0.0)
    steps = np.array([r.steps for r in rollouts], np.int32)
    store.append(job.id, "estimate", 0, Chunk(0, 3, f, np.zeros(3, np.uint8), steps, {}, 0.1))
