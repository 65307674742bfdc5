"""A service with light workers, its dashboard, and Debian's Chromium to look at it."""

from __future__ import annotations

import shutil
import threading
from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from service.client import Client
from service.dashboard.server import Dashboard

BROWSERS = ("chromium", "chromium-browser", "google-chrome")
PATIENCE_MS = 250_000.0  # for anything that a page shows after a while


@contextmanager
def dashboard_of(port: int, **more) -> Iterator[str]:
    """The address of a dashboard for the service at a Zenoh port, served from a thread."""
    with Client(f"tcp/127.0.0.1:{port}", timeout_s=10.0, patience_s=0.0) as client:
        dashboard = Dashboard(client, "127.0.0.1", 0, **more)
        thread = threading.Thread(target=dashboard.run, daemon=True)
        thread.start()
        try:
            yield f"http://127.0.0.1:{dashboard.port}"
        finally:
            dashboard.stop()
            thread.join(30.0)
            assert not thread.is_alive()


@pytest.fixture(scope="session")
def browser():
    """Chromium as the system has it."""
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
