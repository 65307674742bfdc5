"""The I-80 road, drivers that keep their lane, and scenarios made of the built-in one, for every test."""

from __future__ import annotations

import os
from collections.abc import Callable, Generator
from pathlib import Path

import numpy as np
import pytest

from policies import layout
from policies.drivers import DriverModel, load_drivers, save_drivers
from service.world.scenario import Scenario, load_scenario
from service.world.scenario import load as loading
from service.world.sim.road import Road, road_of
from sumo_nets.corridor import Corridor, load_corridor


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(
    item: pytest.Item, call: pytest.CallInfo
) -> Generator[None, pytest.TestReport, pytest.TestReport]:
    """Where TAILROAD_NO_SKIP is set, as CI does, a skipped test is a failed one."""
    report = yield
    if report.skipped and os.environ.get("TAILROAD_NO_SKIP"):
        report.outcome = "failed"
        report.longrepr = f"skipped, which TAILROAD_NO_SKIP forbids: {report.longrepr}"
    return report


# Files that take longest, the longest first: begun last, one of them would keep a core busy when the others are done.
SLOWEST = (
    "tests/e2e/test_command_line.py",
    "tests/service/analysis/run/test_run.py",
    "tests/ce/test_mixture.py",
    "tests/service/studies/human/test_rates.py",
    "tests/service/front/cli/test_failures_cli.py",
    "tests/e2e/test_wheel.py",
    "tests/service/remote/fleet/test_kills.py",
    "tests/service/studies/reproduce/test_verdict_page.py",
    "tests/ce/test_path_sampling.py",
)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """The slowest files first; xdist keeps this order with --no-loadscope-reorder."""
    at = {name: number for number, name in enumerate(SLOWEST)}
    items.sort(key=lambda item: at.get(item.nodeid.split("::")[0], len(SLOWEST)))


ACTION_SCALE = (1.0, 0.05)  # m/s^2, rad/s


@pytest.fixture(scope="session")
def i80() -> Corridor:
    return load_corridor("i80")


@pytest.fixture(scope="session")
def road(i80: Corridor) -> Road:
    return road_of(i80)


def steering_arrays() -> dict[str, np.ndarray]:
    """Weights of a driver that steers to its lane's centre at constant speed, and hidden units that do nothing.

    Unit pairs carry the positive and the negative part of lane offset (m), lane-relative heading (rad) and the turn
    rate of the lane (about 15 m/s times its curvature) unchanged to the head, which sums them up.
    """
    generator = np.random.default_rng(0)
    w1 = generator.normal(size=(layout.OBSERVATION_SIZE, layout.HIDDEN_1)) * 0.02
    w2 = generator.normal(size=(layout.HIDDEN_1, layout.HIDDEN_2)) * 0.05
    head = np.zeros((layout.HIDDEN_2 + 1, layout.OUTPUTS))
    w1[:, :6] = 0.0
    w2[:6] = 0.0
    w2[:, :6] = 0.0
    gains = {layout.LANE_OFFSET_M: -0.02, layout.LANE_HEADING_RAD: -1.0, layout.LANE_CURVATURE_PER_M: 15.0}
    for pair, (value, gain) in enumerate(gains.items()):
        for unit, sign in ((2 * pair, 1.0), (2 * pair + 1, -1.0)):
            w1[value, unit] = sign
            w2[unit, unit] = 1.0
            head[unit, 1] = sign * gain / ACTION_SCALE[1]
    head[-1, 2:] = -2.0, -3.0
    return {
        "w1": w1,
        "b1": np.zeros(layout.HIDDEN_1),
        "w2": w2,
        "b2": np.zeros(layout.HIDDEN_2),
        "mu0": head.ravel(),
        "sigma0": 1e-4 * np.eye(layout.HEAD_SIZE),
        "action_scale": np.array(ACTION_SCALE),
    }


@pytest.fixture(scope="session")
def weights_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A driver model that keeps its lane, with a small spread of its last layer."""
    path = tmp_path_factory.mktemp("weights") / "steering.safetensors"
    return save_drivers(path, steering_arrays(), {"made": "for tests"})


@pytest.fixture(scope="session")
def drivers(weights_file: Path) -> DriverModel:
    return load_drivers(weights_file)


@pytest.fixture(scope="session")
def scenario_text(weights_file: Path) -> str:
    """The text of `i80-paper-10s` with the test's drivers."""
    text = (loading.FOLDER / "i80-paper-10s.toml").read_text(encoding="utf-8")
    assert text.count('weights = "drivers-gail"') == 1
    return text.replace('weights = "drivers-gail"', f'weights = "{weights_file}"')


@pytest.fixture(scope="session")
def make_scenario(scenario_text: str, tmp_path_factory: pytest.TempPathFactory) -> Callable[..., Scenario]:
    """make_scenario({old: new}, more="...") loads the text with replacements (each must occur) and additions."""
    folder = tmp_path_factory.mktemp("scenarios")

    def make(changes: dict[str, str] | None = None, more: str = "") -> Scenario:
        text = scenario_text
        for old, new in (changes or {}).items():
            assert old in text, f"{old!r} is not in the scenario any more"
            text = text.replace(old, new)
        path = folder / "made.toml"
        path.write_text(text + more, encoding="utf-8")
        return load_scenario(str(path))

    return make
