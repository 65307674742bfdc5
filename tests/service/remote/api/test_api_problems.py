"""What is wrong is answered with problem details that say what was given and what was expected."""

from __future__ import annotations

import json
import time
import tomllib
from dataclasses import replace

import pytest

from service.remote.api.limits import Limits
from service.world.scenario import load as loading
from tests.service.remote.api.conftest import LIMITS, Foreign, open_service

JOB = {"scenario": "i80-paper-10s", "ego": "idm", "gamma": 0.5, "method": "naive", "budget": 5}
DEEP = b"[" * 100_000


@pytest.fixture(scope="module")
def job(foreign) -> str:
    return foreign.get("jobs", JOB)["id"]


@pytest.mark.parametrize(
    ("selector", "kind", "says"),
    [
        ("jobs/nope", "no-such-job", "'nope'"),
        ("jobs/nope/estimate", "no-such-job", "'nope'"),
        ("jobs/{job}/estimates", "no-such-key", "estimates"),
        ("jobs/a/b/c/d", "no-such-key", "jobs/a/b/c/d"),
        ("schemas/Nope", "not-found", "Estimate"),
        ("jobs/{job}/estimate?gama=1", "bad-parameter", "did you mean 'gamma'"),
        ("jobs/{job}/estimate?gamma=low", "bad-parameter", "'low'"),
        ("jobs/{job}/estimate?gamma=nan", "bad-parameter", "finite"),
        ("jobs/{job}/estimate?gamma=1;gamma=2", "bad-parameter", "twice"),
        ("jobs/{job}/estimate?confidence=1", "bad-parameter", "confidence"),
        ("jobs/{job}/curve?gammas=1,x", "bad-parameter", "separated by commas"),
        ("jobs/{job}/curve?low=2;high=1", "bad-parameter", "below high"),
        ("jobs/{job}/curve?steps=100000", "bad-parameter", "1000"),
        ("jobs/{job}/failures?limit=0", "bad-parameter", "limit"),
        ("jobs/{job}/failures?by=luck", "bad-parameter", "luck"),
        ("jobs/{job}/rollouts/x", "not-found", "whole number"),
        ("jobs?limit=1001", "bad-parameter", "1000"),
        ("jobs?after=-1", "bad-parameter", "after"),
        ("jobs/*/cancel", "bad-request", "wildcards"),
        ("jobs/*/estimate", "bad-request", "wildcards"),
        ("health?x=1", "bad-parameter", "'x'"),
    ],
)
def test_wrong_questions(foreign, job: str, selector: str, kind: str, says: str) -> None:
    problem = foreign.problem(selector.format(job=job))
    assert problem["type"] == f"urn:tailroad:problem:{kind}"
    assert says in problem["detail"]


@pytest.mark.parametrize(
    ("change", "kind", "says"),
    [
        ({"scenario": "i81"}, "not-found", "i80-paper-10s"),
        ({"scenario": "/etc/passwd"}, "not-found", "/etc/passwd"),
        ({"scenario": 3}, "bad-body", "scenario"),
        ({"ego": "os:system"}, "bad-job", "may import"),
        ({"ego": "nobody"}, "bad-job", "nobody"),
        ({"gamma": None}, "bad-body", "gamma"),
        ({"gamma": "0.5"}, "bad-body", "gamma"),
        ({"method": "magic"}, "bad-body", "magic"),
        ({"budget": 0}, "bad-body", "budget"),
        ({"budget": 10**30}, "bad-body", "budget"),
        ({"budget": 10**12}, "bad-body", "at most"),
        ({"seed": -1}, "bad-body", "seed"),
        ({"confidence": 1.5}, "bad-body", "confidence"),
        ({"options": {"batch_sise": 5}}, "bad-body", "batch_size"),
        ({"options": {"batch_size": 10**9}}, "bad-body", "at most"),
        ({"options": {"batch_size": "all"}}, "bad-body", "batch_size"),
        ({"options": {"batch_size": 0}}, "bad-body", "batch_size"),
        ({"options": {"budget": 5}}, "bad-body", "beside options"),
        ({"label": "x" * 201}, "bad-body", "label"),
        ({"priority": 101}, "bad-body", "priority"),
        ({"colour": "red"}, "bad-body", "colour"),
    ],
)
def test_wrong_submissions(foreign, change: dict, kind: str, says: str) -> None:
    problem = foreign.problem("jobs", JOB | change)
    assert problem["type"] == f"urn:tailroad:problem:{kind}", problem
    assert says in json.dumps(problem)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"network": {"road": "/etc/passwd.net.xml"}}, "files are not taken"),
        ({"network": {"road": "../x.xml", "edges": ["a"]}}, "files are not taken"),
        ({"network": {"road": 5}}, "network.road"),
        ({"drivers": {"weights": "/tmp/w.safetensors"}}, "files are not taken"),
        ({"vehicles": []}, "vehicles"),
        ({"format": 99}, "format"),
        ({"surprise": 1}, "surprise"),
        ({"time": {"horizon_s": 1e9}}, "horizon_s"),
    ],
)
def test_wrong_scenarios_by_value(foreign, change: dict, says: str) -> None:
    data = tomllib.loads((loading.FOLDER / "i80-paper-10s.toml").read_text(encoding="utf-8"))
    problem = foreign.problem("jobs", JOB | {"scenario": data | change})
    assert problem["type"] == "urn:tailroad:problem:bad-scenario"
    assert says in problem["detail"]


@pytest.mark.parametrize(
    "body", [b"{", b"\xff\xfe", b"null", b"[]", b'"x"', DEEP, b'{"scenario": ' + DEEP, b"\x00"]
)
def test_bodies_that_are_no_submission(foreign, body: bytes) -> None:
    assert foreign.problem("jobs", body)["type"] == "urn:tailroad:problem:bad-body"


def test_a_body_where_none_is_taken(foreign) -> None:
    assert foreign.problem("health", {"x": 1})["type"] == "urn:tailroad:problem:bad-request"


def test_a_body_that_is_too_large(foreign) -> None:
    assert foreign.problem("jobs", b" " * (LIMITS.body_bytes + 1))["status"] == 413


@pytest.fixture
def narrow(tmp_path):
    """A service without workers that takes two jobs, and five requests in all."""
    limits = Limits(requests_per_s=0.001, submissions_per_s=0.001, burst=5000.0, open_jobs=2)
    for service in open_service(tmp_path, limits):
        client = Foreign(service.port)
        yield client
        client.close()


def test_open_jobs_and_rates_are_limited(narrow) -> None:
    wide = JOB | {"budget": 1000}
    for _ in range(2):
        narrow.get("jobs", wide)  # no worker: they stay open
    assert narrow.problem("jobs", wide)["type"] == "urn:tailroad:problem:too-many-jobs"
    narrow.get("health")
    narrow.get("health")
    refused = narrow.problem("health")
    assert refused["status"] == 429
    assert refused["retry_after_s"] > 0


def test_names_that_begin_with_an_underscore_are_zenohs_own(foreign) -> None:
    assert foreign.get("health?_raw=true;_time=1")["status"] == "ok"


def test_parameters_may_come_as_http_writes_them(foreign, job: str) -> None:
    found = foreign.get(f"jobs/{job}/curve?gammas=0.1%2C0.2&confidence=0.9")
    assert [p["gamma"] for p in found["points"]] == [0.1, 0.2]


@pytest.fixture
def tight(tmp_path):
    """A service without workers whose open jobs may hold 1 MB together."""
    for service in open_service(tmp_path, replace(LIMITS, open_bytes=1_000_000)):
        client = Foreign(service.port)
        yield client
        client.close()


def test_the_memory_of_open_jobs_is_limited(tight) -> None:
    small = {"budget": 200, "method": "naive"}
    heavy = tight.problem("jobs", JOB | small | {"budget": 5000})
    assert heavy["type"] == "urn:tailroad:problem:bad-job"
    assert "give a smaller budget" in heavy["detail"]
    first, second = (tight.get("jobs", JOB | small)["id"] for _ in range(2))
    deadline = time.monotonic() + 60.0  # the scheduler looks at new jobs in a thread of its own
    while (waits := tight.get(f"jobs/{second}/events")["items"][-1])["kind"] != "waiting":
        assert time.monotonic() < deadline, waits
        time.sleep(0.05)
    assert "memory" in waits["body"]["reason"]
    assert tight.get(f"jobs/{first}/events")["items"][-1]["kind"] == "status"
