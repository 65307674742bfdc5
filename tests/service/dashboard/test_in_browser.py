"""The dashboard as people use it: a real browser on a real service, with light workers in place of SUMO."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from tests.service.api.conftest import Service, open_service
from tests.service.dashboard.conftest import PATIENCE_MS, dashboard_of


@pytest.fixture(scope="module")
def service(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Service]:
    yield from open_service(tmp_path_factory.mktemp("dashboard"))


@pytest.fixture(scope="module")
def address(service: Service) -> Iterator[str]:
    with dashboard_of(service.port) as found:
        yield found


@pytest.fixture
def page(browser, address: str):
    """An empty page of the dashboard; whatever the browser complains of fails the test."""
    context = browser.new_context(base_url=address)
    context.set_default_timeout(PATIENCE_MS)
    opened, complaints = context.new_page(), []
    opened.on("console", lambda said: complaints.append(said.text) if said.type == "error" else None)
    opened.on("pageerror", lambda error: complaints.append(str(error)))
    yield opened
    context.close()
    assert complaints == []


def test_a_service_without_jobs_says_how_to_submit_one(page):
    page.goto("/")
    page.get_by_text("There are no jobs yet").wait_for()
    page.get_by_text("tailroad submit").wait_for()
