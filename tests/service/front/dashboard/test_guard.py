"""Who may ask the dashboard: other sites' pages may not, whatever name they come by."""

from __future__ import annotations

import asyncio

import pytest
from starlette.responses import PlainTextResponse

from service.front.dashboard.guard import Guard
from service.remote.api.hosts import host_name

OWN = "127.0.0.1:7448"


def asked(guard: Guard, method: str = "GET", **headers: str) -> tuple[int, dict[str, str]]:
    """Status and headers of the answer."""
    sent: list[dict] = []

    async def send(message) -> None:
        sent.append(message)

    async def receive() -> dict:
        return {"type": "http.request", "body": b"", "more_body": False}

    pairs = [(name.replace("_", "-").encode(), value.encode()) for name, value in headers.items()]
    scope = {"type": "http", "method": method, "path": "/", "query_string": b"", "headers": pairs}
    asyncio.run(guard(scope, receive, send))
    return sent[0]["status"], {name.decode(): value.decode() for name, value in sent[0]["headers"]}


def guard(**more) -> Guard:
    return Guard(PlainTextResponse("inside"), **more)


@pytest.mark.parametrize(
    "host", [OWN, "localhost:7448", "[::1]:7448", "10.0.0.7", "LOCALHOST", "lab.example.org:1"]
)
def test_its_own_names_and_addresses_are_answered(host):
    assert asked(guard(names=["lab.example.org"]), host=host)[0] == 200


@pytest.mark.parametrize(
    "host", ["evil.example", "localhost.evil.example", "127.0.0.1.evil.example:7448", "", "a b", "x:y"]
)
def test_a_name_that_somebody_else_points_here_is_not(host):
    assert asked(guard(), host=host)[0] == 421


def test_no_host_or_two_are_not_answered():
    assert asked(guard())[0] == 421


def test_forms_of_its_own_pages_pass_and_those_of_others_do_not():
    own = {"host": OWN, "origin": f"http://{OWN}", "sec_fetch_site": "same-origin"}
    assert asked(guard(), "POST", **own)[0] == 200
    for change in (
        {"origin": "http://evil.example"},
        {"origin": "null"},
        {"origin": ""},
        {"origin": "http://127.0.0.1:9999"},
        {"sec_fetch_site": "cross-site"},
        {"sec_fetch_site": "same-site"},
    ):
        assert asked(guard(), "POST", **own | change)[0] == 403, change


def test_other_sites_may_lead_here_but_not_read():
    cross = {"host": OWN, "sec_fetch_site": "cross-site"}
    assert asked(guard(), **cross, sec_fetch_mode="navigate")[0] == 200
    assert asked(guard(), **cross, sec_fetch_mode="no-cors")[0] == 403


def test_read_only_changes_nothing():
    own = {"host": OWN, "origin": f"http://{OWN}"}
    assert asked(guard(read_only=True), "POST", **own)[0] == 403
    assert asked(guard(read_only=True), host=OWN)[0] == 200


@pytest.mark.parametrize("method", ["PUT", "DELETE", "OPTIONS", "TRACE"])
def test_other_methods_are_refused(method):
    assert asked(guard(), method, host=OWN)[0] == 405


@pytest.mark.parametrize("host", [OWN, "evil.example"])
def test_every_answer_forbids_scripts_of_others_and_frames(host):
    _, headers = asked(guard(), host=host)
    policy = headers["content-security-policy"]
    assert "default-src 'none'" in policy
    assert "script-src 'self';" in policy
    assert "unsafe" not in policy
    assert "frame-ancestors 'none'" in policy
    assert headers["x-content-type-options"] == "nosniff"
    assert headers["cache-control"] == "no-store"


def test_host_names_are_read_without_their_port():
    assert [host_name(h) for h in ("A.b.:80", "[::1]", "[::1]:80", ":80")] == ["a.b", "::1", "::1", None]
