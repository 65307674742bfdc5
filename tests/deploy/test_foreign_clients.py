"""Clients without tailroad's code: HTTP through zenohd and its REST plugin, and the example in Rust.

Run by `make foreign-clients`, which builds them. The service is the real one, with a light worker in place of SUMO.
"""

from __future__ import annotations

import http.client
import json
import os
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path

import msgspec
import pytest

from service.remote.api.objects import Estimate
from tests.service.remote.api.conftest import ANSWER_S, LIMITS, Service, client, foreign, service  # noqa: F401 (fixtures)
from tests.service.remote.fleet.light import free_port

pytestmark = [pytest.mark.long, pytest.mark.timeout(600)]

ROOT = Path(__file__).parents[2]
BUILT = Path(os.environ.get("TAILROAD_FOREIGN_CLIENTS", ROOT / "build" / "foreign-clients")) / "bin"
JOB = {"scenario": "i80-paper-10s", "ego": "idm", "gamma": 0.5, "method": "naive", "budget": 400, "seed": 7}
START_S = 60.0


class Http:
    """What curl would do. Each answer is the plugin's list of samples."""

    def __init__(self, port: int):
        self.port = port

    def ask(self, method: str, path: str, body: object = None, **headers: str) -> tuple[int, bytes]:
        connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout=ANSWER_S)
        payload = body if body is None or isinstance(body, bytes) else json.dumps(body).encode()
        connection.request(method, f"/tailroad/v1/{path}", payload, headers)
        answer = connection.getresponse()
        found = answer.status, answer.read()
        connection.close()
        return found

    def get(self, path: str, body: object = None) -> dict:
        (sample,) = json.loads(self.ask("POST" if body else "GET", path, body)[1])
        assert sample["key"] != "ERROR", sample
        assert sample["encoding"] == "application/json"
        return sample["value"]

    def problem(self, path: str, body: object = None) -> dict:
        (sample,) = json.loads(self.ask("POST" if body else "GET", path, body)[1])
        assert sample["key"] == "ERROR", sample
        return sample["value"]


def program(name: str) -> Path:
    assert (BUILT / name).is_file(), f"{BUILT / name} is not there; `make foreign-clients` builds it"
    return BUILT / name


@pytest.fixture(scope="module")
def web(service: Service) -> Iterator[Http]:  # noqa: F811
    port = free_port()
    command = [program("zenohd"), "--config", ROOT / "deploy/examples/http-gateway/gateway.json5",
               "--connect", f"tcp/127.0.0.1:{service.port}", "--rest-http-port", f"127.0.0.1:{port}"]  # fmt: skip
    with subprocess.Popen(command) as gateway:
        try:
            found, deadline = Http(port), time.monotonic() + START_S
            while True:
                assert gateway.poll() is None, "zenohd has ended"
                assert time.monotonic() < deadline, "zenohd answers nothing"
                try:
                    if json.loads(found.ask("GET", "health")[1]):
                        break
                except ConnectionError:
                    pass
                time.sleep(0.1)
            yield found
        finally:
            gateway.kill()


def follow(web: Http, body: dict) -> tuple[dict, list[dict]]:
    """Submit a job; it and its events, as a browser would get them, until it is done."""
    stream = http.client.HTTPConnection("127.0.0.1", web.port, timeout=ANSWER_S)
    stream.request("GET", "/tailroad/v1/jobs/*/events", headers={"Accept": "text/event-stream"})
    events = stream.getresponse()
    web.get("health")  # the subscription has arrived
    job, told = web.get("jobs", body), []
    while not told or told[-1]["body"].get("status") != "done":
        line = events.readline().decode()
        if line.startswith("data:"):
            sample = json.loads(line.removeprefix("data:"))
            if sample["key"] == f"tailroad/v1/jobs/{job['id']}/events":
                told.append(sample["value"])
    stream.close()
    return job, told


def test_a_job_from_submission_to_estimate_over_http(web, client):  # noqa: F811
    job, told = follow(web, JOB)
    assert told[-1]["kind"] == "status"
    estimate = web.get(f"jobs/{job['id']}/estimate?gamma=0.4&confidence=0.9")
    same = client.estimate(job["id"], 0.4, 0.9)
    assert (estimate["p"], *estimate["ci"]) == pytest.approx((same.p, *same.ci), rel=1e-15)
    status, raw = web.ask("GET", f"jobs/{job['id']}/estimate?gamma=0.4;confidence=0.9;_raw=true")
    assert status == 200
    # to the bit; the plugin's list may round the last one
    assert msgspec.json.decode(raw, type=Estimate) == same
    assert job["id"] in {j["id"] for j in web.get("jobs?limit=1000")["items"]}


@pytest.mark.parametrize(
    ("path", "body", "kind"),
    [
        ("jobs/nope", None, "no-such-job"),
        ("jobs/nope/curves", None, "no-such-key"),
        ("jobs?limit=0", None, "bad-parameter"),
        ("jobs?gama=1", None, "bad-parameter"),
        ("jobs/*/cancel", None, "bad-request"),
        ("jobs", JOB | {"gamma": "low"}, "bad-body"),
        ("jobs", b"{", "bad-body"),
        ("jobs", JOB | {"ego": "os:system"}, "bad-job"),
        ("jobs", b" " * (LIMITS.body_bytes + 1), "too-large"),
        ("health", {"x": 1}, "bad-request"),
    ],
)
def test_what_is_wrong_is_told_over_http(web, path, body, kind):
    problem = web.problem(path, body)
    assert problem["type"] == f"urn:tailroad:problem:{kind}"
    assert problem["detail"]


def test_http_publishes_nothing_that_the_service_listens_to(web):
    before = web.get("jobs?limit=1000")
    web.ask("PUT", "jobs", JOB)
    web.ask("DELETE", "jobs")
    assert web.get("jobs?limit=1000") == before


def test_the_gateway_shows_nothing_of_itself_but_its_connection(web):
    """Which any Zenoh session shows to its own process, whatever is configured."""
    connection = http.client.HTTPConnection("127.0.0.1", web.port, timeout=ANSWER_S)
    connection.request("GET", "/@/**")
    shown = [sample["key"] for sample in json.loads(connection.getresponse().read())]
    assert all(key.split("/")[2:5] == ["session", "transport", "unicast"] for key in shown), shown


def rust(service: Service, body: object) -> subprocess.CompletedProcess[str]:  # noqa: F811
    command = [program("tailroad-example-client"), f"tcp/127.0.0.1:{service.port}", json.dumps(body)]
    return subprocess.run(command, capture_output=True, text=True, timeout=ANSWER_S, check=False)


def test_the_client_in_rust_submits_follows_and_reads(service, client):  # noqa: F811
    done = rust(service, JOB | {"seed": 8})
    assert done.returncode == 0, done.stderr
    job = done.stderr.split()[1]
    assert '"status":"done"' in done.stderr
    assert json.loads(done.stdout)["p"] == client.estimate(job).p


def test_the_client_in_rust_is_refused_with_the_problem(service):  # noqa: F811
    refused = rust(service, JOB | {"ego": "os:system"})
    assert refused.returncode == 2
    assert json.loads(refused.stderr)["type"] == "urn:tailroad:problem:bad-job"


def test_the_client_in_rust_says_that_nobody_is_there():
    command = [program("tailroad-example-client"), f"tcp/127.0.0.1:{free_port()}", "{}"]
    alone = subprocess.run(command, capture_output=True, text=True, timeout=ANSWER_S, check=False)
    assert alone.returncode == 1
    assert alone.stderr
