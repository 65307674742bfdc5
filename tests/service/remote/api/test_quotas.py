"""One client's part: open jobs and requests, by its connection."""

from __future__ import annotations

from dataclasses import replace

import pytest

from service.remote.client import Client, Refused
from tests.service.remote.api.conftest import ANSWER_S, LIMITS, open_service

JOB = {"ego": "idm", "method": "naive", "budget": 60}


def test_a_client_has_no_more_open_jobs_than_its_part_and_its_orders_are_written_down(tmp_path):
    for service in open_service(tmp_path, replace(LIMITS, client_open_jobs=2)):
        with Client(f"tcp/127.0.0.1:{service.port}", timeout_s=ANSWER_S) as client:
            first = client.submit("i80-paper-10s", 0.5, **JOB).id
            second = client.submit("i80-paper-10s", 0.5, **JOB).id
            with pytest.raises(Refused, match="this machine has 2 open jobs, and may have no more"):
                client.submit("i80-paper-10s", 0.5, **JOB)
            client.cancel(first)
            client.wait(first)
            third = client.submit("i80-paper-10s", 0.5, **JOB).id
        told = [(e.who, e.did, e.job, bool(e.refused)) for e in service.light.store.log.entries()]
        expected = [("submit", first, False), ("submit", second, False), ("submit", "", True), ("cancel", first, False),
                    ("submit", third, False)]  # fmt: skip
        assert told == [("this machine", *one) for one in expected]


def test_a_client_that_asks_too_often_is_told_when_to_ask_again(tmp_path):
    for service in open_service(tmp_path, replace(LIMITS, client_requests_per_s=1.0, burst=3.0)):
        with Client(f"tcp/127.0.0.1:{service.port}", timeout_s=ANSWER_S, patience_s=0.0) as client:
            for _ in range(3):
                client.jobs()
            with pytest.raises(Refused, match="this machine asks more than 1 times a second"):
                client.jobs()
