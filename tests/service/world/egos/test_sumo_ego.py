"""Egos that SUMO's own car-following models drive."""

from __future__ import annotations

import numpy as np
import pytest

import ce
from service.analysis import trace
from service.errors import InputError
from service.evaluation.job import Problem, make_job
from service.world.egos.open import check_ego, usable_egos
from service.world.egos.sumo import MODELS


@pytest.mark.parametrize("model", MODELS)
def test_it_follows_a_slower_vehicle_ahead_in_its_lane_without_touching_it(make_scenario, model):
    """The vehicle of lane 2 is put into lane 3, 35 m ahead of the ego and 5 m/s slower."""
    scenario = make_scenario(
        {
            'name = "env2"\nlane = 2':
            'name = "env2"\nlane = 3\nstation_m = { distribution = "uniform", low = 150.0, high = 160.0 }'
        }
    )  # fmt: skip
    problem = Problem(make_job(scenario, f"sumo:{model}", 0.5, "naive", 3, {}))
    x, noise_seeds = ce.draw(problem.base, 3, "estimate", 0, 0, 1)
    x[0, :4] = 115.0, 0.0, 0.0, 18.0
    x[0, 8:12] = 150.0, 0.0, 0.0, 13.0
    with problem.simulator() as simulator:
        traced = trace.record(problem, simulator, x[0], int(noise_seeds[0]))
    assert traced.rollout.outcome == "horizon", traced.rollout
    gap = traced.station_m[:, 2] - traced.station_m[:, 0] - 4.5
    speed = np.diff(traced.station_m[:, 0]) / 0.1
    assert gap.min() > 1.0
    assert abs(speed[-10:].mean() - 13.0) < 2.5  # it has fallen in behind


def test_it_drives_at_its_desired_speed_on_a_free_lane(make_scenario):
    problem = Problem(make_job(make_scenario(), "sumo:IDM", 0.5, "naive", 3, {}))
    x, noise_seeds = ce.draw(problem.base, 3, "estimate", 0, 0, 1)
    with problem.simulator() as simulator:
        first = simulator.run(x[0], int(noise_seeds[0]))
        traced = trace.record(problem, simulator, x[0], int(noise_seeds[0]))
    assert first == traced.rollout
    speed = np.diff(traced.station_m[:, 0]) / 0.1
    assert speed[-1] > speed[0] + 2.0
    assert speed.max() < 25.0


def test_names_are_checked_and_listed():
    check_ego("sumo:Krauss")
    assert "sumo:EIDM" in usable_egos()
    with pytest.raises(InputError, match="there are sumo:Krauss, "):
        check_ego("sumo:Kraus")
