"""Worker processes, one ego service and one renderer: rollouts a second by where the ego and its pictures are made.

    python -m tests.bench.ego_placement [--ego lidar | --ego vision] [--rollouts 100] [--json]

Physics (SUMO, drivers, sensors) runs in worker processes. The ego runs in them, or in one service process that all of
them ask over TCP. For an ego that looks the pictures are made in the workers and sent to the service raw or as JPEG, or
made by one renderer process. The same rollouts are run in turns in all these ways, so that a busy machine slows all; f
has to be the same to the bit, except by way of JPEG, which loses some.
"""

import contextlib
import json
import os
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass

import click
import numpy as np

import ce
from policies.egos import load_ego
from service.evaluation.job import Problem, make_job
from service.evaluation.pool import LocalPool, Work
from service.world.egos.settings import EgoSettings
from service.world.scenario import load_scenario

CHUNK = 5
INSIDE = "ego and pictures in the workers"
SERVICE = (
    "import sys\nfrom service.world.egos.sdk import serve\nfrom policies.egos import load_ego\n"
    "serve(lambda: load_ego(sys.argv[1]), sys.argv[1], listen=sys.argv[2], camera=sys.argv[3] or None)"
)


@dataclass(frozen=True)
class Way:
    """Where things are: whether the ego is in a service, how pictures reach it, and who makes them."""

    service: bool
    camera: str = ""  # of the service: "", "raw" or "jpeg"
    renderer: bool = False


def ways(looks: bool) -> dict[str, Way]:
    if not looks:
        return {INSIDE: Way(False), "one ego service": Way(True)}
    return {
        INSIDE: Way(False),
        "one renderer": Way(False, renderer=True),
        "one ego service, raw pictures of the workers": Way(True, "raw"),
        "one ego service, JPEG pictures of the workers": Way(True, "jpeg"),
        "one ego service, one renderer": Way(True, "raw", renderer=True),
    }


def _free_address() -> str:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return f"tcp/127.0.0.1:{probe.getsockname()[1]}"


def _measure(pools: dict[str, LocalPool], x: np.ndarray, noise_seeds: np.ndarray, rounds: int) -> dict:
    """Rollouts a second of each pool, the median and the range of rounds taken in turns; the median of each round's
    ratio to INSIDE, as all of a round share what the machine was like; and whether all gave the same f.

    Pictures by way of JPEG may give another f.
    """
    work = [Work(i, x[i : i + CHUNK], noise_seeds[i : i + CHUNK]) for i in range(0, len(x), CHUNK)]
    rates: dict[str, list[float]] = {name: [] for name in pools}
    found: dict[str, bytes] = {}
    for number in range(rounds + 1):  # the first round warms up
        click.echo(f"round {number} of {rounds}", err=True)
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
        "range": {name: (min(values), max(values)) for name, values in rates.items()},
        "share_of_the_first": {
            name: float(np.median(np.divide(values, rates[INSIDE]))) for name, values in rates.items()
        },
        "same_bits": len({bits for name, bits in found.items() if "JPEG" not in name}) == 1,
    }


@contextlib.contextmanager
def _process(*command: str) -> Iterator[None]:
    """A process that says a line when it is ready, while the block runs."""
    with subprocess.Popen([sys.executable, *command], stdout=subprocess.PIPE) as process:
        try:
            assert process.stdout is not None
            if not process.stdout.readline():
                raise SystemExit(f"{command[:2]} ended before it was ready")
            yield
        finally:
            process.kill()


def compare(scenario: str, ego: str, rollouts: int, rounds: int, counts: list[int]) -> list[dict]:
    """A row for each number of workers."""
    loaded = load_scenario(scenario)
    looks = bool(getattr(load_ego(ego), "wants_camera", False))
    x, noise_seeds = ce.draw(
        Problem(make_job(loaded, ego, 0.0, "naive", 1, {})).base, 1, "estimate", 0, 0, rollouts
    )
    cameras = sorted({way.camera for way in ways(looks).values() if way.service})
    services = {camera: _free_address() for camera in cameras}
    renderer = _free_address()
    rows = []
    with contextlib.ExitStack() as stack:
        for camera, address in services.items():
            stack.enter_context(_process("-c", SERVICE, ego, address, camera))
        if looks:
            stack.enter_context(_process("-m", "service.world.egos.renderer", scenario, "--listen", renderer))
        for workers in counts:
            with contextlib.ExitStack() as pools:
                made: dict[str, LocalPool] = {}
                for name, way in ways(looks).items():
                    settings = EgoSettings(
                        address=services[way.camera] if way.service else renderer,
                        renderer=renderer if way.renderer else None,
                        deadline_s=60.0,
                        patience_s=60.0,
                    )
                    os.environ.update(settings.as_environment())  # workers have it from here
                    job = make_job(loaded, f"zenoh:{ego}" if way.service else ego, 0.0, "naive", 1, {})
                    made[name] = pools.enter_context(LocalPool(job, workers))
                    made[name].warm_up()
                    # all are started
                    for _ in made[name].run([Work(0, x[:1], noise_seeds[:1])] * (4 * workers)):
                        pass
                rows.append({"workers": workers, **_measure(made, x, noise_seeds, rounds)})
    return rows


@click.command()
@click.option("--scenario", default="i80-10s", show_default=True)
@click.option("--ego", default="lidar", show_default=True)
@click.option("--rollouts", default=100, show_default=True)
@click.option(
    "--rounds", type=click.IntRange(1), default=3, show_default=True, help="Each way is taken so often."
)
@click.option("--workers", type=int, multiple=True, default=(1, 2), show_default=True)
@click.option("--json", "as_json", is_flag=True)
def main(
    scenario: str, ego: str, rollouts: int, rounds: int, workers: tuple[int, ...], as_json: bool
) -> None:
    rows = compare(scenario, ego, rollouts, rounds, list(workers))
    if as_json:
        click.echo(json.dumps(rows, indent=2))
        return
    for row in rows:
        rates = row["rollouts_per_s"]
        click.echo(f"{row['workers']} workers; same bits: {row['same_bits']}")
        for name, rate in rates.items():
            low, high = row["range"][name]
            share = row["share_of_the_first"][name]
            click.echo(
                f"  {name:48} {rate:7.2f} rollouts/s (median; {low:.2f} to {high:.2f}), {share:.2f} of the first"
            )


if __name__ == "__main__":
    main()
