"""The whole site: built, sound, and looked at as files, in a browser without a network."""

from __future__ import annotations

from pathlib import Path

import pytest

from docs.site.__main__ import build
from tests.service.conftest import PATIENCE_MS, browser  # noqa: F401


@pytest.fixture(scope="module")
def site(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("build")
    assert build(folder) == []
    return folder / "docs"


def test_the_site_is_built_and_nothing_is_wrong_with_it(site):
    assert (site / "index.html").exists()
    assert (site / "decisions" / "0100-documentation-site.html").exists()


def test_pages_opened_as_files_can_be_searched_and_fetch_nothing(site, browser):  # noqa: F811
    page = browser.new_page()
    fetched: list[str] = []
    page.on("request", lambda request: fetched.append(request.url))
    page.goto((site / "index.html").as_uri())
    page.get_by_role("button", name="Search").first.click()
    page.wait_for_selector("dialog[aria-label=Search][open]", timeout=PATIENCE_MS)
    page.keyboard.type("threat model")
    page.wait_for_selector("a[role=option][href*='threat-model.html']", timeout=PATIENCE_MS)
    assert [url for url in fetched if not url.startswith((site.as_uri(), "data:", "about:"))] == []


def test_a_page_fits_a_narrow_screen(site, browser):  # noqa: F811
    page = browser.new_page(viewport={"width": 390, "height": 800})
    for name in ("index.html", "ce/index.html", "reference/command-line.html", "results/index.html"):
        page.goto((site / name).as_uri())
        assert page.evaluate("document.documentElement.scrollWidth") <= 390, name
