"""Thresholds of rare events: the service's own values without SUMO, and order statistics with their intervals."""

import numpy as np
import pytest

import ce
from policies.drivers import load_drivers
from policies.egos import load_ego
from service.training.thresholds import Rollouts, thresholds_of
from service.world.scenario import load_scenario
from service.world.scenario.base import base_distribution
from service.world.scenario.check import check_road
from service.world.sim.rollout import OUTCOMES, Simulator


@pytest.mark.parametrize("name", ["i80-paper-10s", "i80-10s"])
def test_values_are_those_of_the_service(name):
    """With the paper's measure and drivers, and with those who err and a measure that goes below 0."""
    scenario = load_scenario(name)
    drivers = load_drivers(scenario.drivers.weights)
    algorithm = ce.algorithm("naive", base_distribution(scenario, drivers), 0.2, ce.NaiveOptions(budget=1000))
    batch = algorithm.propose(algorithm.init(7))
    assert batch is not None
    alone = Rollouts(scenario, drivers, load_ego("lidar"))
    with Simulator(scenario, check_road(scenario, scenario.name), drivers, load_ego("lidar")) as simulator:
        for x, seed in zip(batch.x[:5], batch.noise[:5], strict=True):
            expected = simulator.run(x, int(seed))
            f, end = alone.f(x, int(seed))
            assert (f, OUTCOMES[end]) == (expected.f, expected.outcome)


def test_thresholds_of_uniform_values():
    """P(f <= 1000 g) = g: each threshold is near p, and its interval holds p and is as wide as counting makes it."""
    f = 1000.0 * np.random.default_rng(1).random(200_000)
    found = thresholds_of(f)
    assert [one["p"] for one in found] == [1e-2, 1e-3, 1e-4, 1e-5]
    for one in found[:3]:
        low, high = one["interval_95"]
        assert low < 1000.0 * one["p"] < high
        assert (high - low) / 1000.0 / one["p"] == pytest.approx(4.0 / np.sqrt(one["events"]), rel=0.4)
    none, high = found[3][
        "interval_95"
    ]  # two values are expected below: not even the smallest is surely above it
    assert none is None
    assert found[3]["gamma"] == round(np.sort(f)[1], 4)
    assert high > 1000.0 * 1e-5
    assert thresholds_of(f[:40]) == []


def test_coverage_of_the_intervals():
    rng = np.random.default_rng(2)
    inside = 0
    for _ in range(200):
        low, high = thresholds_of(1000.0 * rng.random(3000))[0]["interval_95"]
        inside += low <= 10.0 <= high
    assert inside >= 182  # 95% of 200, less three standard errors
