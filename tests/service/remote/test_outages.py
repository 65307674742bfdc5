"""What is told of a service that is not well, does not let somebody in, or stops."""

from __future__ import annotations

import http.client
import socket
import subprocess
import threading
import time
from pathlib import Path

import pytest

from service.front.dashboard import impatient
from service.front.dashboard.server import Dashboard
from service.remote.api.metrics import Metrics
from service.remote.client import Client, NoAnswer, Refused
from service.remote.client import line as module
from service.remote.client.line import Line
from service.remote.fleet.sessions import router_session
from tests.service.remote.fleet.light import LIMIT_S, free_port, light_fleet
from tests.service.remote.fleet.processes import Process, serve

MAKE_SECURITY = Path(__file__).resolve().parents[3] / "deploy" / "zenoh" / "make-security"


def address(port: int) -> str:
    return f"tcp/127.0.0.1:{port}"


def test_health_is_told_by_the_database_and_a_key_that_there_is_not_by_a_problem(tmp_path):
    port = free_port()
    service = serve(tmp_path, port)
    service.wait_line("serving on")
    with Client(address(port)) as client:
        assert client.health().status == "ok"
        with pytest.raises(Refused, match="there is no key tailroad/v1/nonsense") as caught:
            client.get("nonsense")
        assert caught.value.kind == "no-such-key"
        file = tmp_path / "fleet.sqlite"
        whole = file.read_bytes()
        file.write_bytes(b"\x00" * 4096)
        with pytest.raises(Refused, match=r"the database is not well: .* is damaged"):
            client.health()
        file.write_bytes(whole)
        assert client.health().status == "ok"
        file.rename(tmp_path / "elsewhere")
        with pytest.raises(Refused, match="the database is not well: cannot read"):
            client.health()
    said = Process("health", "--connect", address(port))
    assert said.process.wait(LIMIT_S) == 1
    said.wait_line("the database is not well")
    service.kill()


def security(folder: Path) -> Path:
    made = subprocess.run(
        ["sh", str(MAKE_SECURITY), str(folder), "localhost", "127.0.0.1"], capture_output=True
    )
    assert made.returncode == 0, made.stderr
    return folder


def test_a_certificate_of_another_authority_and_too_few_rights_are_told_apart_from_nobody(tmp_path):
    ours, theirs = security(tmp_path / "ours"), security(tmp_path / "theirs")
    where = f"tls/localhost:{free_port()}"
    with router_session([where], str(ours / "scheduler.json5")):
        with Client(where, str(theirs / "client.json5"), 60.0) as stranger:
            began = time.monotonic()
            with pytest.raises(NoAnswer, match="does not let this side in: it asks for a certificate"):
                stranger.health()
            assert time.monotonic() - began < 60.0  # not only when all the time to wait is over
        with (
            Client(where, str(ours / "worker.json5"), 20.0) as worker,
            pytest.raises(NoAnswer, match="is connected, and nobody answers there: the rights"),
        ):
            worker.health()
    with (
        Client(where, str(ours / "client.json5"), 1.0) as client,
        pytest.raises(NoAnswer, match="nobody answers at"),
    ):
        client.health()


def test_a_worker_that_is_not_let_in_says_so(tmp_path):
    ours, theirs = security(tmp_path / "ours"), security(tmp_path / "theirs")
    where = f"tls/localhost:{free_port()}"
    with router_session([where], str(ours / "scheduler.json5")):
        worker = Process("worker", "--connect", where, "--zenoh-config", str(theirs / "worker.json5"))
        worker.wait_line("does not let this side in")
        worker.kill()


class Empty:
    """A session whose first answers are empty, as after a pause longer than its lease."""

    def __init__(self, empty: int):
        self.asked: list[str] = []
        self._empty = empty
        self.info = self

    def routers_zid(self) -> list[str]:
        return ["router"]

    def get(self, selector, payload=None, **_):
        self.asked.append(selector)
        if len(self.asked) <= self._empty:
            return iter(())
        found = type("Sample", (), {"payload": type("Z", (), {"to_bytes": lambda self: b"{}"})()})()
        return iter([type("Reply", (), {"ok": found, "err": None})()])


def test_an_empty_answer_is_asked_for_again_and_an_order_is_given_once(monkeypatch):
    monkeypatch.setattr(module, "AGAIN_S", (0.0, 0.0, 0.0))
    line = Line([address(1)], None, 5.0)
    line._open = Empty(2)  # type: ignore[assignment]
    assert line.ask("tailroad/v1/jobs") == (True, b"{}")
    assert line._open.asked == ["tailroad/v1/jobs"] * 3  # type: ignore[union-attr]
    line = Line([address(1)], None, 5.0)
    line._open = Empty(2)  # type: ignore[assignment]
    assert line.ask("tailroad/v1/jobs", b"{}") == (True, b"{}")
    assert line._open.asked == ["tailroad/v1/about"] * 3 + ["tailroad/v1/jobs"]  # type: ignore[union-attr]
    line._open = Empty(1)  # type: ignore[assignment]
    with pytest.raises(NoAnswer):
        line.ask("tailroad/v1/jobs", b"{}")


def test_serve_stops_with_pages_open_and_their_streams_end(tmp_path):
    port, page = free_port(), free_port()
    service = Process("serve", "--home", str(tmp_path), "--listen", address(port), "--workers", "0",
                      "--dashboard", str(page))  # fmt: skip
    service.wait_line("dashboard on")
    service.wait_line("the service answers")
    connections = []
    for path in ("/live", "/live?job=x"):
        connection = http.client.HTTPConnection("127.0.0.1", page, timeout=LIMIT_S)
        connection.request("GET", path)
        answer = connection.getresponse()
        assert answer.read(5) == b"retry"
        connections.append(answer)
    assert service.stop() == 0
    for answer in connections:
        answer.read()  # to its end
    said = "".join(service.lines)
    assert "Traceback" not in said
    assert "Cancel" not in said


def test_half_open_requests_of_the_dashboard_end(tmp_path, monkeypatch):
    monkeypatch.setattr(impatient, "HEADER_S", 0.2)
    with Client(address(free_port()), None, 0.1, patience_s=0.0) as client:
        dashboard = Dashboard(client, "127.0.0.1", 0)
        thread = threading.Thread(target=dashboard.run)
        thread.start()
        try:
            for sent in (b"", b"GET / HTTP/1.1\r\nHost: local"):
                with socket.create_connection(("127.0.0.1", dashboard.port), LIMIT_S) as half:
                    half.sendall(sent)
                    assert half.recv(1000) == b""
        finally:
            dashboard.stop()
            thread.join()


def test_metrics_are_served_by_an_address_and_not_by_somebody_s_name(tmp_path):
    port = free_port()
    with light_fleet(tmp_path) as fleet:
        server = Metrics(fleet.fleet).serve(str(port))
        try:
            for host, status in (
                ("127.0.0.1", 200),
                (f"localhost:{port}", 200),
                ("evil.example", 421),
                ("", 421),
            ):
                connection = http.client.HTTPConnection("127.0.0.1", port, timeout=LIMIT_S)
                connection.putrequest("GET", "/metrics", skip_host=True)
                if host:
                    connection.putheader("Host", host)
                connection.endheaders()
                assert connection.getresponse().status == status, host
                connection.close()
        finally:
            server.close()
