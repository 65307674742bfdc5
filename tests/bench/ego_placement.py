"""Worker processes and one ego service: rollouts a second where the ego is in the worker, and where it is elsewhere.

    python -m tests.bench.ego_placement [--rollouts 100] [--json]

Physics (SUMO, drivers, sensors) runs in worker processes, the ego in one service process that all of them ask over TCP.
The same rollouts are run in turns with the ego in the workers, so that a busy machine slows both; f has to be the same
to the bit.
"""

import json
import os
import socket
import subprocess
import sys
import time

import click
import numpy as np

import ce
from service.egos.settings import EgoSettings
from service.job import Problem, make_job
from service.pool import LocalPool, Work
from service.scenario import load_scenario
from service.scenario.schema import Scenario

CHUNK = 10
SERVICE = (
    "import sys\nfrom service.egos.sdk import serve\nfrom policies.egos import load_ego\n"
    "serve(lambda: load_ego(sys.argv[1]), sys.argv[1], listen=sys.argv[2])"
)


def _free_address() -> str:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return f"tcp/127.0.0.1:{probe.getsockname()[1]}"


def _measure(pools: dict[str, LocalPool], x: np.ndarray, noise: np.ndarray, rounds: int) -> dict:
    """Rollouts a second of each pool, the median of rounds taken in turns, and whether all gave the same f."""
    work = [Work(i, x[i : i + CHUNK], noise[i : i + CHUNK]) for i in range(0, len(x), CHUNK)]
    rates: dict[str, list[float]] = {name: [] for name in pools}
    found: dict[str, bytes] = {}
    for number in range(rounds + 1):  # the first round warms up
        for name, pool in pools.items():
            began = time.perf_counter()
            chunks = sorted(pool.run(list(work)), key=lambda chunk: chunk.start)
            if number:
                rates[name].append(len(x) / (time.perf_counter() - began))
            errors = {reason for chunk in chunks for reason in chunk.errors.values()}
            if errors:
                raise SystemExit(f"{name}: rollouts failed: {errors}")
            found[name] = b"".join(chunk.f.tobytes() for chunk in chunks)
    return {
        "rollouts_per_s": {name: float(np.median(values)) for name, values in rates.items()},
        "same_bits": len(set(found.values())) == 1,
    }


def compare(scenario: Scenario, ego: str, rollouts: int, rounds: int, counts: list[int]) -> list[dict]:
    """A row for each number of workers."""
    address = _free_address()
    settings = EgoSettings(address=address, deadline_s=60.0, patience_s=60.0)
    os.environ.update(settings.as_environment())
    inside = make_job(scenario, ego, 0.0, "naive", 1, {})
    outside = make_job(scenario, f"zenoh:{ego}", 0.0, "naive", 1, {})
    x, noise = ce.draw(Problem(inside).base, 1, "estimate", 0, 0, rollouts)
    rows = []
    with subprocess.Popen([sys.executable, "-c", SERVICE, ego, address], stdout=subprocess.PIPE) as service:
        try:
            assert service.stdout is not None
            service.stdout.readline()  # ready
            for workers in counts:
                with LocalPool(inside, workers) as one, LocalPool(outside, workers) as other:
                    one.warm_up()
                    other.warm_up()
                    measured = _measure({"in the workers": one, "one service": other}, x, noise, rounds)
                rows.append({"workers": workers, **measured})
        finally:
            service.kill()
    return rows


@click.command()
@click.option("--scenario", default="i80-10s", show_default=True)
@click.option("--ego", default="lidar", show_default=True)
@click.option("--rollouts", default=100, show_default=True)
@click.option("--rounds", default=3, show_default=True)
@click.option("--json", "as_json", is_flag=True)
def main(scenario: str, ego: str, rollouts: int, rounds: int, as_json: bool) -> None:
    rows = compare(load_scenario(scenario), ego, rollouts, rounds, [1, 2])
    if as_json:
        click.echo(json.dumps(rows, indent=2))
        return
    for row in rows:
        rates = row["rollouts_per_s"]
        click.echo(
            f"{row['workers']} workers: {rates['in the workers']:.1f} rollouts/s with the ego in them, "
            f"{rates['one service']:.1f} with one ego service over TCP (ratio "
            f"{rates['one service'] / rates['in the workers']:.2f}); same bits: {row['same_bits']}"
        )


if __name__ == "__main__":
    main()
