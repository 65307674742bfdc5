"""The example ego in Rust: built from the same schema, and driving over TCP. `make example-ego`."""

from __future__ import annotations

import shutil
import socket
import subprocess
from pathlib import Path

import pytest

import ce
from service.evaluation.job import Problem, make_job
from service.world.egos.open import open_ego
from service.world.egos.settings import EgoSettings
from service.world.sim.rollout import Simulator

EXAMPLE = Path(__file__).parents[2] / "deploy/examples/rust-ego"


@pytest.fixture
def address() -> str:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return f"tcp/127.0.0.1:{probe.getsockname()[1]}"


@pytest.mark.long
@pytest.mark.timeout(1800)
def test_the_rust_ego_drives_like_the_driver_it_implements(make_scenario, address):
    """The same intelligent driver as `idm`: whole rollouts come out alike, to what rounding does to them."""
    assert shutil.which("cargo"), "the example needs cargo (https://rustup.rs)"
    subprocess.run(["cargo", "build", "--release"], cwd=EXAMPLE, check=True)
    target = subprocess.run(
        ["cargo", "metadata", "--format-version", "1", "--no-deps"],
        cwd=EXAMPLE,
        check=True,
        capture_output=True,
        text=True,
    )
    program = (
        Path(target.stdout.split('"target_directory":"')[1].split('"')[0]) / "release/tailroad-example-ego"
    )
    problem = Problem(make_job(make_scenario(), "idm", 0.5, "naive", 1, {}))
    x, noise_seeds = ce.draw(problem.base, 1, "estimate", 0, 0, 5)
    with problem.simulator() as simulator:
        expected = [simulator.run(row, int(seed)) for row, seed in zip(x, noise_seeds, strict=True)]
    with subprocess.Popen([program, "rust", address], stdout=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout is not None
            assert "ready" in process.stdout.readline()
            settings = EgoSettings(address=address, deadline_s=60.0, patience_s=60.0)
            ego = open_ego("zenoh:rust", problem.job.scenario, problem.corridor, settings)
            with Simulator(problem.job.scenario, problem.corridor, problem.drivers, ego) as simulator:
                found = [simulator.run(row, int(seed)) for row, seed in zip(x, noise_seeds, strict=True)]
                again = [simulator.run(row, int(seed)) for row, seed in zip(x, noise_seeds, strict=True)]
        finally:
            process.kill()
    assert [r.error for r in found] == [None] * 5
    assert found == again
    for mine, theirs in zip(found, expected, strict=True):
        assert (mine.outcome, mine.steps) == (theirs.outcome, theirs.steps)
        assert mine.f == pytest.approx(theirs.f, rel=1e-6)
