"""Metrics and logs, by choice."""

from __future__ import annotations

import json
import logging
import urllib.request

import pytest

from service.errors import InputError
from service.logs import JsonLines
from service.remote.api.metrics import Metrics
from tests.service.remote.fleet.light import free_port


def test_metrics_are_scraped(service) -> None:
    metrics = Metrics(service.light.fleet)
    metrics.seen("estimate", 200, 0.01)
    port = free_port()
    server = metrics.serve(str(port))
    try:
        with urllib.request.urlopen(f"http://127.0.0.1:{port}/metrics", timeout=60) as answer:
            text = answer.read().decode()
    finally:
        server.close()
    assert 'tailroad_api_requests_total{action="estimate",status="200"} 1.0' in text
    assert "tailroad_workers 1.0" in text
    assert "tailroad_scheduler_up 1.0" in text


@pytest.mark.parametrize("address", ["x", "127.0.0.1:", "127.0.0.1:99999999"])
def test_addresses_that_are_none(service, address: str) -> None:
    with pytest.raises(InputError, match="HOST:PORT"):
        Metrics(service.light.fleet).serve(address)


def test_a_log_line_is_one_object_with_its_fields() -> None:
    record = logging.LogRecord("tailroad.api", logging.INFO, "", 0, "job %s\nis done", ("j1",), None)
    record.fields = {"job": "j1", "odd": object}
    line = JsonLines().format(record)
    assert "\n" not in line
    told = json.loads(line)
    assert (told["level"], told["text"], told["job"]) == ("info", "job j1\nis done", "j1")
