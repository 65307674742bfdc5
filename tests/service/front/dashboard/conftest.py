"""A service with light workers, its dashboard, and Debian's Chromium to look at it."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager

from service.front.dashboard.server import Dashboard
from service.remote.client import Client


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
