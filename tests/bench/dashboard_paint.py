"""How soon a browser shows a job of a million rollouts, just after the service began.

    python -m tests.bench.dashboard_paint [--rollouts N] [--replayed]

Writes a job of naive Monte Carlo (values from a generator) through the store, as a fleet leaves it, starts `tailroad
serve` without workers on it, and opens the page of the job in Chromium. Prints one JSON object: seconds to the first
paint, to p with its interval, to the charts, and bytes sent; for a first visit and for a second one.

--replayed: without the state that a fleet keeps of a job that is done, as in a database of an earlier version: the
first visit waits until the record is replayed, for the charts (minutes for a million), not for p.
"""

from __future__ import annotations

import argparse
import json
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import msgspec
import numpy as np
from playwright.sync_api import TimeoutError, sync_playwright

import ce
from service.evaluation.job import Problem, make_job
from service.evaluation.store import Chunk, Origin
from service.evaluation.store.jobs import JobStore
from service.evaluation.store.states import LastState
from service.remote.client import Client, NoAnswer
from service.world.scenario import load_scenario
from tests.service.remote.fleet.light import free_port

BATCH, CHUNK = 20_000, 1000
WAIT_S = 900.0


def tell(text: str) -> None:
    print(f"{time.strftime('%H:%M:%S')} {text}", file=sys.stderr, flush=True)


def write_job(home: Path, rollouts: int, keep: bool = True) -> str:
    """The job's record, as a fleet leaves it. keep: with its last state."""
    options = {"budget": rollouts, "batch_size": BATCH}
    job = make_job(load_scenario("i80-paper-10s"), "idm", 0.01, "naive", 1, options)
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
            store.append([("jmillion", "estimate", 0, chunk, Origin("w", 0))])
        if keep:
            problem = Problem(job)
            begun = problem.algorithm.init(problem.stream_seed)
            last = msgspec.structs.replace(begun, f=f, interim_at=rollouts, done=True)
            record = store.chunks.digest("jmillion")
            state = problem.algorithm.to_bytes(last)
            store.states.keep(LastState("jmillion", 0, -(-rollouts // BATCH), record, state))
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
    page.set_default_timeout(1000.0 * WAIT_S)
    began = time.perf_counter()
    seen = {}
    page.goto(address, wait_until="commit")
    page.locator("#estimate").wait_for()
    seen["estimate_s"] = time.perf_counter() - began
    paint = page.evaluate("performance.getEntriesByName('first-contentful-paint')[0].startTime")
    seen["first_paint_s"] = paint / 1000.0
    tell(
        f"painted after {seen['first_paint_s']:.2f} s, p after {seen['estimate_s']:.2f} s; waits for the charts"
    )
    while True:
        try:
            page.locator("#chart-curve polyline").first.wait_for(timeout=10_000.0)
            break
        except TimeoutError:
            waited = time.perf_counter() - began
            if waited > WAIT_S:
                raise
            shown = page.locator("#part-course").inner_text().strip().replace("\n", " ")
            tell(f"{waited:.0f} s, in the charts' place: {shown[:100]!r}")
    seen["charts_s"] = time.perf_counter() - began
    tell(f"charts after {seen['charts_s']:.2f} s")
    seen["bytes"] = page.evaluate(
        "[...performance.getEntriesByType('resource'), ...performance.getEntriesByType('navigation')]"
        ".reduce((sum, one) => sum + one.transferSize, 0)"
    )
    page.context.close()
    return {name: round(value, 3) for name, value in seen.items()}


def main(rollouts: int, keep: bool) -> dict:
    with tempfile.TemporaryDirectory() as folder:
        tell(f"writes a job of {rollouts:,} rollouts")
        job, port, web = write_job(Path(folder), rollouts, keep), free_port(), free_port()
        endpoint = f"tcp/127.0.0.1:{port}"
        serve = [sys.executable, "-m", "service.front.cli", "serve", "--home", folder, "--listen", endpoint,
                 "--workers", "0", "--dashboard", str(web)]  # fmt: skip
        tell("starts the service")
        with subprocess.Popen(serve, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as server:
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
    return {"rollouts": rollouts, "replayed": not keep, "first_visit": first, "second_visit": second}


if __name__ == "__main__":
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--rollouts", type=int, default=1_000_000)
    parser.add_argument("--replayed", action="store_true")
    asked = parser.parse_args()
    print(json.dumps(main(asked.rollouts, not asked.replayed), indent=2))
