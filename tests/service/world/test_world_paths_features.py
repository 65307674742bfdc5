"""What a committor is told of a state of the highway, and what leads to a contact."""

from __future__ import annotations

import numpy as np
import pytest

import ce
from service.evaluation.job import Problem, make_job
from service.world.paths.features import ITS_NEXT_ACCELERATION, ITS_TURN_SPREAD, NEAREST, NEAREST_THIRD
from service.world.paths.level import FARTHEST_S, level_of
from service.world.paths.nearest import FARTHEST, nearest
from service.world.scenario import load_scenario


@pytest.fixture(scope="module")
def process():
    return Problem(make_job(load_scenario("i80-10s"), "lidar", 0.5, "naive", 3, {})).paths


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_two_that_go_on_to_touch_are_at_no_distance_from_ahead_and_from_behind(sign):
    distance, when_s, along_m, across_m = nearest(sign * 14.5, 0.5, -sign * 5.0, 0.0, 0.0, 4.5, 1.8)
    assert (distance, when_s, along_m, across_m) == (0.0, 2.0, 0.0, 0.0)


def test_what_passes_at_a_distance_is_nearer_the_sooner_and_braking_counts():
    soon, late = (nearest(ahead, 3.5, -5.0, 0.0, 0.0, 4.5, 1.8)[0] for ahead in (2.0, 14.5))
    assert soon > late > 0.0  # what is far off may still come nearer
    assert (
        nearest(14.5, 0.0, 0.0, 0.0, 0.0, 4.5, 1.8)[0]
        > nearest(14.5, 0.0, 0.0, 0.0, -5.0, 4.5, 1.8)[0]
        == 0.0
    )
    assert nearest(500.0, 0.0, 20.0, 0.0, 0.0, 4.5, 1.8)[0] == FARTHEST


def test_the_level_counts_gaps_along_and_across():
    assert level_of(10.0, 0.0, 5.0) == 2.0
    assert level_of(-1.0, 0.5, -3.0) == 2.0  # beside each other
    assert level_of(10.0, 0.5, 5.0) == 4.0
    assert level_of(10.0, 0.0, -1.0) == FARTHEST_S


def test_a_contact_is_the_measure_itself_and_all_else_is_above_it(process):
    x, seeds = ce.draw(process.base, 4, "estimate", 0, 0, 20)
    x[:10, 3], x[:10, 7::4][:, :5] = 20.0, 10.0
    x[:10, [1, 5, 9, 13, 17, 21]] = 0.0
    states = process.begin(x, seeds)
    for until in process.checkpoints[1:]:
        states = process.advance(states, seeds + np.uint64(until), until)
    level = process.level(states)
    touched = states.smallest <= 0.0
    np.testing.assert_array_equal(level[touched], states.smallest[touched])
    assert (level[~touched] > 0.0).all()
    assert (level <= FARTHEST_S).all()


def test_what_drivers_mean_to_do_is_known_once_they_drive(process):
    x, seeds = ce.draw(process.base, 4, "estimate", 0, 0, 6)
    states = process.begin(x, seeds)
    own = slice(ITS_NEXT_ACCELERATION, ITS_TURN_SPREAD + 1)
    assert (process.features(states)[..., own] == 0.0).all()
    states = process.advance(states, seeds, 5)
    told = process.features(states)
    assert (np.abs(told[..., own]).max(axis=(0, 1)) > 0.0).all()
    states.heads[:] *= np.float32(0.5)  # other weights xi
    changed = process.features(states)
    assert (changed[..., own] != told[..., own]).any()
    np.testing.assert_array_equal(changed[..., :ITS_NEXT_ACCELERATION], told[..., :ITS_NEXT_ACCELERATION])
    assert (told[..., NEAREST] <= FARTHEST).all()
    assert (told[..., NEAREST_THIRD] >= 0.0).all()
