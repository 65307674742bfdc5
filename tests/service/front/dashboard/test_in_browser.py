"""The dashboard as people use it: a real browser on a real service, with light workers in place of SUMO."""

from __future__ import annotations

import re
import threading
import tomllib
from collections.abc import Iterator
from pathlib import Path

import pytest

from service.remote.api.server import Api
from service.remote.client import Client
from service.remote.fleet.messages import Answer, Failed, Lease
from service.world.scenario import load_scenario
from service.world.scenario.fixed import toml_of
from tests.service.conftest import PATIENCE_MS
from tests.service.front.dashboard.conftest import dashboard_of
from tests.service.remote.api.conftest import LIMITS, Service, open_service
from tests.service.remote.fleet.light import LightRunner, LightWorker

# rollouts are run again in processes of their own: long on a busy machine
pytestmark = pytest.mark.timeout(900)


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


class Unhurried(LightRunner):
    """Takes its time, and none of the processor's."""

    def run(self, lease: Lease) -> Answer | Failed:
        threading.Event().wait(0.2)
        return super().run(lease)


@pytest.fixture(scope="module")
def ended(service: Service) -> tuple[str, str]:
    """Two jobs that are done, on the same draws, with a few dangerous rollouts each."""
    worker = service.worker("early")
    try:
        with Client(f"tcp/127.0.0.1:{service.port}", timeout_s=60.0) as client:
            jobs = [
                client.submit(
                    "i80-paper-10s", 0.03, ego=ego, method="naive", budget=600, seed=2, label=f"{ego} drives"
                )
                for ego in ("lidar", "idm")
            ]
            assert [client.wait(job.id).status for job in jobs] == ["done", "done"]
    finally:
        worker.stop()
    return jobs[0].id, jobs[1].id


def test_a_job_is_submitted_and_its_estimate_moves_before_the_eyes(page, service: Service):
    page.goto("/submit")
    page.get_by_label("Label", exact=True).fill("<b>Müller & Co</b>")
    page.get_by_label("Ego", exact=True).select_option("idm")
    page.get_by_label("Threshold").fill("0.4")
    page.get_by_label("Method", exact=True).select_option("naive")
    page.get_by_label("Budget").fill("20000")
    page.get_by_text("More settings").click()
    page.get_by_label("Options of the method").fill("batch_size=500")
    page.get_by_role("button", name="Submit").click()
    page.get_by_role("heading", name="<b>Müller & Co</b>").wait_for()
    page.get_by_text("No estimate yet").wait_for()
    worker = LightWorker(service.port, "watched", Unhurried)
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
    page.get_by_text("jobs fits").wait_for()


def test_what_happens_before_the_page_listens_is_told_when_it_does(page, service: Service):
    """The job ends between the drawing of its page and the opening of the page's event source."""
    with Client(f"tcp/127.0.0.1:{service.port}", timeout_s=60.0) as client:
        job = client.submit(
            "i80-paper-10s", 0.03, ego="idm", method="naive", budget=600, seed=3, label="Ended early"
        )

        def end_the_job_first(route) -> None:
            client.cancel(job.id)
            assert client.wait(job.id).status == "cancelled"
            route.continue_()

        page.route(re.compile(r"/live\?"), end_the_job_first)
        drawn = page.goto(f"/jobs/{job.id}", wait_until="commit")
        assert "state-running" in drawn.text()
        page.locator(".state-cancelled").wait_for()


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
    page.get_by_label("Options of the method").fill("")
    page.get_by_label("Budget").fill("5")
    page.get_by_role("button", name="Submit").click()
    assert "budget of at least 1000" in page.locator("#field-budget-error").inner_text()
    assert page.get_by_label("Threshold").input_value() == "0.4"


def test_a_failure_is_opened_and_replayed(page, ended: tuple[str, str]):
    page.goto(f"/jobs/{ended[0]}/failures")
    page.locator("#replay-1").click()
    page.locator("#stage").wait_for()
    time, now = page.locator("#time"), page.locator("#now")
    assert "time to collision" in now.inner_text()
    time.focus()
    page.keyboard.press("Home")
    assert now.inner_text().startswith("t = 0.0 s")
    page.get_by_role("button", name="Play").click()
    page.wait_for_function("() => Number(document.querySelector('#time').value) >= 5")
    page.get_by_role("button", name="Pause").click()
    stopped = time.input_value()
    page.locator("#road").click()
    page.keyboard.press("ArrowRight")
    assert int(time.input_value()) == int(stopped) + 1
    painted = (
        "() => { const c = document.querySelector('#road'); const d = c.getContext('2d')"
        ".getImageData(0, 0, c.width, c.height).data; const seen = new Set();"
        " for (let i = 0; i < d.length; i += 404) seen.add(d.slice(i, i + 3).join()); return seen.size }"
    )
    assert page.evaluate(painted) > 4  # road, markings, ego and others
    page.locator("#chart-action svg").wait_for()  # its measure may lie above what its chart draws
    exports = page.get_by_role("link", name="Film").get_attribute("href")
    assert (
        exports
        == f"/jobs/{ended[0]}/rollouts/{page.url.partition('/rollouts/')[2].partition('?')[0]}/export/mp4"
        "?phase=estimate&iteration=0"
    )


def test_any_rollout_is_found_by_its_ending_and_replayed(page, ended: tuple[str, str]):
    page.goto(f"/jobs/{ended[0]}")
    page.locator("#endings a", has_text="finished").click()
    page.get_by_label("Order").select_option("-f")
    page.get_by_text("that fit, of 600").wait_for()
    first = page.locator(".jobs tbody tr").first
    first.get_by_role("link", name="Replay").click()
    page.locator("#stage").wait_for()
    page.get_by_text("not dangerous").wait_for()


def test_dangerous_rollouts_are_chosen_by_a_parameter_and_replayed(page, ended: tuple[str, str]):
    page.goto(f"/jobs/{ended[0]}/parameters")
    rows = page.locator("#chosen tbody tr")
    rows.first.wait_for()
    before, lines = rows.count(), page.locator("#parallel polyline").count()
    assert lines >= before > 1
    assert page.locator("#scatter .cells rect").count() > 10
    page.get_by_label("up to").fill(rows.nth(0).locator("td").nth(0).inner_text())  # the lowest f, rounded
    page.get_by_role("button", name="Choose").click()
    page.get_by_text("Chosen: ").wait_for()
    assert rows.count() < before
    page.get_by_role("button", name="All again").click()
    assert rows.count() == before
    rows.first.get_by_role("link", name="Replay").click()
    page.locator("#stage").wait_for()


def test_a_clone_of_an_own_scenario_keeps_it(page, service: Service):
    text = toml_of(load_scenario("i80-paper-10s")).replace("horizon_s = 10.0", "horizon_s = 4.0")
    with Client(f"tcp/127.0.0.1:{service.port}", timeout_s=60.0) as client:
        mine = client.submit(tomllib.loads(text), 0.3, ego="idm", measure="box-ttc", label="mine", budget=50)
        client.cancel(mine.id)
        page.goto(f"/submit?like={mine.id}")
        page.locator("#forecast, #part-forecast p").first.wait_for()
        assert page.get_by_label("Label", exact=True).input_value() == "mine"
        page.get_by_role("button", name="Submit").click()
        page.get_by_role("heading", name="mine").wait_for()
        again = page.url.rpartition("/")[2]
        assert again != mine.id
        assert client.scenario(again).text == client.scenario(mine.id).text
        assert "horizon_s = 4.0" in client.scenario(again).text
        assert client.job(again).measure == "box-ttc"
        client.cancel(again)


def test_two_jobs_are_compared(page, ended: tuple[str, str]):
    page.goto(f"/compare?jobs={ended[0]}")
    page.get_by_label("idm drives").check()
    page.get_by_role("button", name="Compare").click()
    page.get_by_role("heading", name="idm drives against lidar drives").wait_for()
    page.get_by_text("the same for both").wait_for()
    assert page.locator("#chart-together polyline").count() >= 2


def test_the_risk_is_said_with_its_interval_and_beside_ones_own_baseline(page, ended: tuple[str, str]):
    page.goto(f"/jobs/{ended[0]}/risk?baseline=own&rate=2.5&source=our+fleet")
    said = page.locator(".summary")
    said.wait_for()
    assert "interval" in said.inner_text()
    page.get_by_text("our fleet").wait_for()
    page.goto(f"/jobs/{ended[0]}/risk?baseline=own&rate=nonsense")
    page.get_by_text("give events per million km").wait_for()


def test_the_report_is_downloaded(page, ended: tuple[str, str]):
    page.goto(f"/jobs/{ended[0]}")
    with page.expect_download() as download:
        page.locator("#report").click()
    text = Path(download.value.path()).read_text(encoding="utf-8")
    assert text.lower().startswith("<!doctype html>")
    assert "lidar" in text


def test_on_a_phone_nothing_is_wider_than_the_page(page, ended: tuple[str, str]):
    page.set_viewport_size({"width": 390, "height": 844})
    for path in ("/", "/submit", "/fleet", "/compare", f"/jobs/{ended[0]}", f"/jobs/{ended[0]}/failures"):
        page.goto(path)
        page.locator("main h1").first.wait_for()
        assert page.evaluate("document.documentElement.scrollWidth") == 390, path
        unnamed = (
            "() => [...document.querySelectorAll('main button, main a, main input:not([type=hidden]), main select')]"
            ".filter((e) => !(e.textContent?.trim() || e.labels?.length || e.ariaLabel)).length"
        )
        assert page.evaluate(unnamed) == 0, path


def test_a_page_outlives_the_service(page, service: Service, ended: tuple[str, str]):
    page.goto("/")
    page.get_by_role("link", name="idm drives").wait_for()
    service.api.close()
    service.light.shut()
    page.get_by_text("The service does not answer").wait_for()
    assert page.get_by_role("link", name="idm drives").is_visible()  # what it was stays
    service.light.open()
    service.api = Api(service.light._session, service.light.fleet, (), LIMITS)
    page.get_by_text("The service does not answer").wait_for(state="hidden")
    page.locator("#link[data-here=yes]").wait_for()
    with Client(f"tcp/127.0.0.1:{service.port}", timeout_s=60.0) as client:
        client.submit("i80-paper-10s", 0.03, budget=100, label="after the restart")
    page.get_by_role("link", name="after the restart").wait_for()
    assert page.evaluate("performance.getEntriesByType('navigation').length") == 1
