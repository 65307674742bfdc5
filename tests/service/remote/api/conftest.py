"""A fleet with its API in this process, and light workers in place of SUMO."""

from __future__ import annotations

import json
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest
import zenoh

from service.remote.api.limits import Limits
from service.remote.api.server import Api
from service.remote.client import Client
from service.remote.fleet.policy import Policy
from tests.service.remote.fleet.light import LIMIT_S, LightFleet, LightWorker, light_fleet

LIMITS = Limits(requests_per_s=1e6, submissions_per_s=1e6)
ANSWER_S = 60.0


class Foreign:
    """A client that knows Zenoh, JSON and the key space, and no tailroad code."""

    def __init__(self, port: int):
        config = zenoh.Config()
        config.insert_json5("mode", '"client"')
        config.insert_json5("connect/endpoints", f'["tcp/127.0.0.1:{port}"]')
        config.insert_json5("scouting/multicast/enabled", "false")
        self.session = zenoh.open(config)

    def ask(self, selector: str, body: object = None) -> tuple[bool, dict]:
        """Whether it is an answer and not a problem, and what it says."""
        payload = body if body is None or isinstance(body, bytes) else json.dumps(body).encode()
        (reply,) = self.session.get(f"tailroad/v1/{selector}", payload=payload, timeout=ANSWER_S)
        told = reply.ok if reply.ok is not None else reply.err
        assert str(told.encoding) == "application/json"
        return reply.ok is not None, json.loads(told.payload.to_bytes())

    def get(self, selector: str, body: object = None) -> dict:
        ok, answer = self.ask(selector, body)
        assert ok, answer
        return answer

    def problem(self, selector: str, body: object = None) -> dict:
        ok, answer = self.ask(selector, body)
        assert not ok, answer
        assert {"type", "title", "status", "detail"} <= set(answer)
        return answer

    def close(self) -> None:
        self.session.close()


@dataclass
class Service:
    light: LightFleet
    api: Api
    port: int

    def worker(self, name: str = "w1") -> LightWorker:
        """One that the service knows when this returns."""
        worker = LightWorker(self.port, name)
        deadline = time.monotonic() + LIMIT_S
        while name not in {known.id for known in self.light.fleet.workers()}:  # each look waits for the hub
            assert time.monotonic() < deadline
        return worker


def open_service(folder: Path, limits: Limits = LIMITS, offered: tuple[str, ...] = ()) -> Iterator[Service]:
    policy = Policy(audit_share=0.0, progress_s=0.05, hold_s=0.5, open_bytes=limits.open_bytes)
    with light_fleet(folder, policy) as light:
        opened = Service(light, Api(light._session, light.fleet, offered, limits), light.port)
        try:
            yield opened
        finally:
            opened.api.close()  # the last one, where a test began another


@pytest.fixture(scope="module")
def service(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Service]:
    """A service with one light worker."""
    for opened in open_service(tmp_path_factory.mktemp("service")):
        worker = opened.worker()
        yield opened
        worker.stop()


@pytest.fixture(scope="module")
def foreign(service: Service) -> Iterator[Foreign]:
    client = Foreign(service.port)
    yield client
    client.close()


@pytest.fixture(scope="module")
def client(service: Service) -> Iterator[Client]:
    with Client(f"tcp/127.0.0.1:{service.port}", timeout_s=ANSWER_S) as opened:
        yield opened
