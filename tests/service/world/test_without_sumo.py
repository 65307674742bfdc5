"""Rollouts without SUMO: the same bits, and a difference is noticed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import ce
from service.errors import InputError, ScenarioError, SimulationError
from service.evaluation.job import Problem, compiled, in_sumo, make_job
from service.world.safety.measure import with_measure
from service.world.scenario import load_scenario
from service.world.scenario.base import dimension
from service.world.scenario.noise_mode import with_noise_mode
from service.world.sim import audited
from service.world.sim.audited import Audited
from service.world.sim.without_sumo import WithoutSumo


def opened(scenario, ego):
    problem = Problem(make_job(scenario, ego, 0.5, "naive", 3, {}))
    return problem, WithoutSumo(scenario, problem.corridor, problem.drivers, ego)


@pytest.mark.parametrize(
    ("scenario", "measure", "ego"),
    [
        ("i80-paper-10s", "ttc", "lidar"),
        ("us101-paper-10s", "ttc", "idm"),
        ("i80-paper-10s", "ttc-impact", "lidar"),
    ],
)
def test_a_rollout_without_sumo_has_the_bits_of_one_with_it(scenario, measure, ego):
    """With the shipped drivers, of whom some change lanes and some rollouts end in a collision."""
    problem, alone = opened(with_measure(load_scenario(scenario), measure), ego)
    x, noise_seeds = ce.draw(problem.base, 3, "estimate", 0, 0, 40)
    # a fast ego among slow vehicles
    x[:8, [4 * v + 3 for v in range(6)]] = [
        20.0,
        10.0,
        10.0,
        10.0,
        20.0,
        10.0,
    ]
    x[:8, 10] = np.linspace(-20.0, 20.0, 8)  # degrees: a neighbour that starts across its lane
    with problem.simulator() as simulator:
        pairs = [
            (alone.run(a, int(s)), simulator.run(a, int(s))) for a, s in zip(x, noise_seeds, strict=True)
        ]
    assert all(one == two for one, two in pairs)
    assert {"horizon", "collision"} <= {one.outcome for one, _ in pairs}
    if measure == "ttc-impact":
        assert all((one.outcome == "collision") == (one.f <= 0.0) for one, _ in pairs)
        assert min(one.f for one, _ in pairs) < -1.0


def test_frozen_noise_and_given_noise_are_the_same_too(make_scenario):
    frozen = make_scenario(
        {'noise_mode = "drawn"': 'noise_mode = "frozen"', "horizon_s = 10.0": "horizon_s = 2.0"}
    )
    problem, alone = opened(frozen, "idm")
    x, _ = ce.draw(problem.base, 3, "estimate", 0, 0, 2)
    normals = np.random.default_rng(1).normal(size=(20, 6, 2))
    with problem.simulator() as simulator:
        assert alone.run(x[0], 5) == simulator.run(x[0], 6)
        assert alone.run(x[1], action_noise=normals) == simulator.run(x[1], action_noise=normals)


def test_what_needs_sumo_is_refused(make_scenario):
    scenario = load_scenario("i80-paper-10s")
    with pytest.raises(InputError, match="needs SUMO"):
        opened(with_measure(scenario, "rss"), "idm")
    problem, _ = opened(scenario, "idm")
    with pytest.raises(InputError, match="needs SUMO"):
        WithoutSumo(scenario, problem.corridor, problem.drivers, "zenoh:mine")


def test_a_share_of_the_rollouts_is_compared_and_a_difference_ends_the_run(make_scenario):
    job = make_job(make_scenario({"horizon_s = 10.0": "horizon_s = 1.0"}), "idm", 0.5, "naive", 3, {})
    x, _ = ce.draw(Problem(job).base, 3, "estimate", 0, 0, 1)
    with compiled(job) as world:
        assert isinstance(world, Audited)
        world.run(x[0], 7)
        assert world.in_sumo == 0
        world.run(x[0], 2 * audited.EVERY)
        assert world.in_sumo == 1
        honest = world._alone.run
        world._alone.run = lambda x, seed: replace(honest(x, seed), f=np.nextafter(honest(x, seed).f, 0.0))
        world.run(x[0], 7)
        with pytest.raises(SimulationError, match="same to the bit"):
            world.run(x[0], audited.EVERY)


def test_sumo_drives_every_rare_event_and_a_share_of_frequent_ones(make_scenario):
    short = make_scenario({"horizon_s = 10.0": "horizon_s = 1.0"})
    x, _ = ce.draw(Problem(make_job(short, "idm", 0.5, "naive", 3, {})).base, 3, "estimate", 0, 0, 1)
    with compiled(make_job(short, "idm", 1e9, "naive", 3, {})) as world:  # every rollout is an event
        for chunk in range(1, 3):
            world.begin_chunk()
            for seed in range(11, 20 + audited.EVENTS):
                world.run(x[0], seed)
            assert world.in_sumo == chunk * (audited.EVENTS + 1)  # and noise seed 20
    with in_sumo(make_job(short, "idm", 0.5, "naive", 3, {})) as world:
        world.run(x[0], 7)
        assert world.in_sumo == 1


def test_searched_noise_is_a_part_of_x_and_the_same_in_both_worlds(make_scenario):
    """The vector's noise drives the rollout, whatever the seed; a search can move it."""
    drawn = make_scenario({"horizon_s = 10.0": "horizon_s = 2.0"})
    searched = with_noise_mode(drawn, "searched")
    problem, alone = opened(searched, "idm")
    base = problem.base
    assert base.dim == dimension(searched) == 24 + 404 + 20 * 6 * 2
    assert base.names is not None
    assert base.names[-1] == "env6.turn_rate_noise[19]"
    x, noise_seeds = ce.draw(base, 3, "estimate", 0, 0, 3)
    _, ordinary = opened(drawn, "idm")
    with problem.simulator() as simulator:
        for row, seed in zip(x, noise_seeds, strict=True):
            one = alone.run(row, int(seed))
            assert one == simulator.run(row, int(seed)) == alone.run(row, int(seed) + 1)
            assert one == ordinary.run(row[:428], action_noise=row[428:].reshape(20, 6, 2).copy())
        moved = x[0].copy()
        moved[428:] *= -1.0
        assert alone.run(moved, 1).f != alone.run(x[0], 1).f


def test_too_much_noise_to_search_is_refused():
    with pytest.raises(ScenarioError, match="a search takes"):
        with_noise_mode(load_scenario("i80-paper"), "searched")
