"""How soon a browser shows a job of a million rollouts, just after the service began.

    python -m tests.bench.dashboard_paint [ROLLOUTS]

Writes a job of naive Monte Carlo (values from a generator) through the store, starts `tailroad serve` without workers
on it, and opens the page of the job in Chromium. Prints one JSON object: seconds to the first paint, to p with its
interval, to the charts, and bytes sent; for a first visit and for a second one.
"""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from playwright.sync_api import sync_playwright

import ce
from service.client import Client, NoAnswer
from service.job import make_job
from service.scenario import load_scenario
from service.store import Chunk, Origin
from service.store.jobs import JobStore
from tests.service.fleet.light import free_port

BATCH, CHUNK = 20_000, 1000
WAIT_MS = 900_000.0


def write_job(home: Path, rollouts: int) -> str:
    """The job's record, as a fleet would have left it."""
    options = {"budget": rollouts, "batch_size": BATCH}
    job = make_job(load_scenario("i80-10s"), "idm", 0.01, "naive", 1, options)
    f = np.random.default_rng(1).random(rollouts) * 4.0
    with JobStore(f"sqlite:///{home / 'fleet.sqlite'}") as store:
        store.add_job("jmillion", job, 0, 1.0, "A million rollouts", "running")
        for start in range(0, rollouts, CHUNK):
            n = min(CHUNK, rollouts - start)
            chunk = Chunk(
                start,
                start + n,
                f[start : start + n],
                np.zeros(n, np.uint8),
                np.full(n, 100, np.int32),
                {},
                0.01 * n,
            )
            store.append([("jmillion", "estimate", 0, chunk, Origin("", "w", 0))])
        small = ce.Product([ce.Beta(2.0, 2.0)])  # the records follow from f alone
        naive = ce.algorithm("naive", small, 0.01, ce.OPTIONS["naive"](**options))
        state, records = naive.init(1), []
        while (batch := naive.propose(state)) is not None:
            state, record = naive.update(state, batch, f[batch.start : batch.stop])
            records.append(record)
        store.add_iterations("jmillion", 0, 0, records)
        store.add_event("jmillion", "status", {"status": "done", "reason": ""})
    return "jmillion"


def visit(browser, address: str) -> dict[str, float]:
    """One visit with an empty cache."""
    page = browser.new_context().new_page()
    page.set_default_timeout(WAIT_MS)
    began = time.perf_counter()
    seen = {}
    page.goto(address, wait_until="commit")
    page.locator("#estimate").wait_for()
    seen["estimate_s"] = time.perf_counter() - began
    paint = page.evaluate("performance.getEntriesByName('first-contentful-paint')[0].startTime")
    seen["first_paint_s"] = paint / 1000.0
    print({name: round(value, 3) for name, value in seen.items()}, file=sys.stderr, flush=True)
    page.locator("#chart-curve polyline").first.wait_for()
    seen["charts_s"] = time.perf_counter() - began
    seen["bytes"] = page.evaluate(
        "[...performance.getEntriesByType('resource'), ...performance.getEntriesByType('navigation')]"
        ".reduce((sum, one) => sum + one.transferSize, 0)"
    )
    page.context.close()
    return {name: round(value, 3) for name, value in seen.items()}


def main(rollouts: int) -> dict:
    with tempfile.TemporaryDirectory() as folder:
        job, port, web = write_job(Path(folder), rollouts), free_port(), free_port()
        endpoint = f"tcp/127.0.0.1:{port}"
        serve = [sys.executable, "-m", "service.cli", "serve", "--home", folder, "--listen", endpoint, "--workers", "0",
                 "--dashboard", str(web)]  # fmt: skip
        with subprocess.Popen(serve, stderr=subprocess.DEVNULL) as server:
            try:
                while True:
                    try:
                        with Client(endpoint, timeout_s=5.0) as client:
                            client.health()
                        break
                    except NoAnswer:
                        time.sleep(0.2)
                with sync_playwright() as started:
                    found = shutil.which("chromium") or shutil.which("google-chrome")
                    browser = started.chromium.launch(executable_path=found, args=["--no-sandbox"])
                    address = f"http://127.0.0.1:{web}/jobs/{job}"
                    first = visit(browser, address)
                    second = visit(browser, address)
                    browser.close()
            finally:
                server.terminate()
    return {"rollouts": rollouts, "first_visit": first, "second_visit": second}


if __name__ == "__main__":
    print(json.dumps(main(int(sys.argv[1]) if len(sys.argv) > 1 else 1_000_000), indent=2))
