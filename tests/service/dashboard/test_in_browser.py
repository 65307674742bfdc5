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
    """An empty page of the dashboard. What the browser complains of fails the test, but for answers that are not 200:
    each page says itself what is wrong."""
    context = browser.new_context(base_url=address)
    context.set_default_timeout(PATIENCE_MS)
    opened, complaints = context.new_page(), []
    opened.on("console", lambda said: complaints.append(said.text) if said.type == "error" else None)
    opened.on("pageerror", lambda error: complaints.append(str(error)))
    yield opened
    context.close()
    assert [said for said in complaints if not said.startswith("Failed to load resource")] == []


def test_a_service_without_jobs_says_how_to_submit_one(page):
    page.goto("/")
    page.get_by_text("There are no jobs yet").wait_for()
    page.get_by_text("tailroad submit").wait_for()


def test_a_job_is_submitted_and_its_estimate_moves_before_the_eyes(page, service: Service):
    page.goto("/submit")
    page.get_by_label("Label", exact=True).fill("<b>Müller & Co</b>")
    page.get_by_label("Ego", exact=True).select_option("idm")
    page.get_by_label("Threshold").fill("0.4")
    page.get_by_label("Method", exact=True).select_option("naive")
    page.get_by_label("Budget").fill("100000")
    page.get_by_role("button", name="Submit").click()
    page.get_by_role("heading", name="<b>Müller & Co</b>").wait_for()
    page.get_by_text("No estimate yet").wait_for()
    worker = service.worker("watched")
    try:
        first = page.locator("#estimate")
        first.wait_for()
        seen = first.inner_text()
        page.wait_for_function("seen => document.querySelector('#estimate').innerText !== seen", arg=seen)
        page.locator("#chart-estimate polyline").wait_for()
        assert page.evaluate("performance.getEntriesByType('navigation').length") == 1  # no reload
        page.get_by_text("Cancel …").click()
        page.get_by_role("button", name="Cancel the job").click()
        page.locator(".state-cancelled").wait_for()
    finally:
        worker.stop()
    page.goto("/?search=m%C3%BCller&state=cancelled")
    page.get_by_role("link", name="<b>Müller & Co</b>").wait_for()
    page.get_by_label("Search").fill("nothing like it")
    page.get_by_role("button", name="Show").click()
    page.get_by_text("None of 1 jobs fits").wait_for()


def test_what_is_wrong_stands_beside_the_field(page):
    page.goto("/submit")
    page.get_by_label("Threshold").fill("0.4")
    page.get_by_text("More settings").click()
    page.get_by_label("Options of the method").fill("rho=0.1\nroh=2")
    page.get_by_label("Method", exact=True).select_option("ce")
    page.get_by_role("button", name="Submit").click()
    page.get_by_text("It was not submitted").wait_for()
    error = page.locator("#field-options-error")
    assert "did you mean 'rho'?" in error.inner_text()
    assert page.get_by_label("Threshold").input_value() == "0.4"
