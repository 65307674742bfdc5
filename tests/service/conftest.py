"""Debian's Chromium, for every page that people look at."""

from __future__ import annotations

import shutil

import pytest

BROWSERS = ("chromium", "chromium-browser", "google-chrome")
PATIENCE_MS = 250_000.0  # for anything that a page shows after a while


@pytest.fixture(scope="module")
def browser():
    """Chromium as the system has it.

    While it is open Playwright keeps an event loop running in this thread, in which neither a second Playwright nor
    `asyncio.run` starts: hence one fixture for all, closed with the module that uses it.
    """
    playwright = pytest.importorskip(
        "playwright.sync_api", reason="Playwright is not installed: make test does it"
    )
    found = next(filter(None, map(shutil.which, BROWSERS)), None)
    if found is None:
        pytest.skip(f"none of {', '.join(BROWSERS)} is installed; on Debian: apt-get install chromium")
    with playwright.sync_playwright() as started:
        opened = started.chromium.launch(executable_path=found, args=["--no-sandbox", "--disable-gpu"])
        yield opened
        opened.close()
