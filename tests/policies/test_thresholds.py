"""Thresholds of rare events: the service's own values without SUMO, and order statistics with their intervals."""

from argparse import Namespace
from types import SimpleNamespace

import numpy as np
import pytest
from rich.progress import Progress

import ce
from policies.drivers import load_drivers
from policies.egos import load_ego
from policies.training.thresholds import Rollouts, below, off_the_curve, thresholds_of
from service.scenario import load_scenario
from service.scenario.base import base_distribution
from service.scenario.check import check_road
from service.sim.rollout import OUTCOMES, Simulator


def test_values_are_those_of_the_service():
    scenario = load_scenario("i80-10s")
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
    """P(f <= g) = g: each threshold is near p, and its interval holds p and is as wide as counting makes it."""
    f = np.random.default_rng(1).random(200_000)
    found = thresholds_of(f)
    assert [one["p"] for one in found] == [1e-2, 1e-3, 1e-4]
    for one in found:
        low, high = one["interval_95"]
        assert low < one["p"] < high
        assert (high - low) / one["p"] == pytest.approx(4.0 / np.sqrt(one["events"]), rel=0.4)


def test_coverage_of_the_intervals():
    rng = np.random.default_rng(2)
    inside = 0
    for _ in range(200):
        low, high = thresholds_of(rng.random(3000))[0]["interval_95"]
        inside += low <= 1e-2 <= high
    assert inside >= 182  # 95% of 200, less three standard errors


def test_a_threshold_is_read_off_a_curve_where_it_and_its_band_reach_p():
    """p(g) = g between 0 and 1, its band a fifth below and a quarter above."""
    known = SimpleNamespace(
        curve=lambda g: SimpleNamespace(p=g, low=0.8 * g, high=1.25 * g), rollouts=7, method="splitting"
    )
    found = off_the_curve(known, 0.1, 0.9, 0.5)
    assert found is not None
    assert found["gamma_s"] == pytest.approx(0.5, abs=3e-3)
    assert found["interval_95"] == pytest.approx([0.4, 0.625], abs=3e-3)
    assert off_the_curve(known, 0.1, 0.4, 0.5) is None
    assert off_the_curve(known, 0.6, 0.9, 0.5) is None
    assert off_the_curve(known, 0.45, 0.55, 0.5)["interval_95"] == [None, None]  # type: ignore[index]


def test_splitting_goes_down_until_the_rarest_threshold_is_reached(tmp_path):
    """P(f <= g) grows tenfold with each 0.1 s: 1e-5 at 0.9 s, 2e-4 at 1.03 s, 5e-7 at 0.77 s."""
    base = ce.Product([ce.Uniform(0.0, 1.0), ce.Uniform(0.0, 1.0)])
    steep = SimpleNamespace(f=lambda x, noise: (1.0 + 0.1 * np.log10(1e4 * x[0]), 0))
    arguments = Namespace(splitting=6000, seed=3)
    with Progress(disable=True) as progress:
        known = [{"p": 1e-2}, {"p": 1e-3}, {"p": 1e-4}]
        found = below(base, 1.03, arguments, steep, tmp_path, progress, "u", known)  # type: ignore[arg-type]
    assert found["deep"][-1]["interval_95"][1] < 1e-5
    rarest = found["thresholds"][-1]
    assert rarest["p"] == 1e-5
    low, high = rarest["interval_95"]
    assert low < 0.9 < high
    assert rarest["gamma_s"] == pytest.approx(0.9, abs=0.04)  # a factor of 2.5 in p
