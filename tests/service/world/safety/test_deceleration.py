"""Required deceleration: by hand, and against braking step by step."""

from __future__ import annotations

import math

import pytest

from service.world import agents as A
from service.world.safety.deceleration import MOST_MPS2, required_deceleration

EGO = (0.0, 0.0, 0.0, 20.0)


def test_it_is_the_square_of_the_difference_of_speeds_over_twice_the_gap(agents_of):
    assert required_deceleration(agents_of(EGO, (24.5, 0.0, 0.0, 10.0)), 2, 0) == pytest.approx(100.0 / 40.0)


def test_a_faster_follower_has_to_brake_too(agents_of):
    assert required_deceleration(agents_of(EGO, (-24.5, 0.0, 0.0, 30.0)), 2, 0) == pytest.approx(100.0 / 40.0)


@pytest.mark.parametrize("other", [(24.5, 0.0, 0.0, 25.0), (24.5, 3.6, 0.0, 5.0), (-24.5, 0.0, 0.0, 19.0)])
def test_nobody_has_to_brake_for_one_that_drives_away_or_in_another_lane(agents_of, other):
    assert required_deceleration(agents_of(EGO, other), 2, 0) == 0.0


def test_no_deceleration_helps_any_more_where_the_boxes_overlap(agents_of):
    assert required_deceleration(agents_of(EGO, (3.0, 0.0, 0.0, 25.0)), 2, 0) == MOST_MPS2
    assert required_deceleration(agents_of(EGO, (4.5001, 0.0, 0.0, 0.0)), 2, 0) == MOST_MPS2


def test_the_hardest_of_all_counts_and_those_that_left_do_not(agents_of):
    agents = agents_of(EGO, (50.0, 0.0, 0.0, 10.0), (24.5, 0.0, 0.0, 10.0), (10.0, 0.0, 0.0, 0.0))
    agents[3, A.ACTIVE] = 0.0
    assert required_deceleration(agents, 4, 0) == pytest.approx(2.5)


@pytest.mark.parametrize(("gap", "mine", "yours"), [(10.0, 20.0, 15.0), (35.0, 30.0, 8.0), (3.0, 6.0, 0.0)])
def test_it_is_the_least_constant_deceleration_that_avoids_the_crash(agents_of, gap, mine, yours):
    def crashes(deceleration: float) -> bool:
        dt, distance, speed = 1e-3, gap, mine
        while speed > yours:
            new = speed - deceleration * dt
            distance += (yours - 0.5 * (speed + new)) * dt
            speed = new
        return distance < 0.0

    low, high = 0.0 + 1e-6, 50.0
    for _ in range(40):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if crashes(middle) else (low, middle)
    found = required_deceleration(agents_of((0.0, 0.0, 0.0, mine), (gap + 4.5, 0.0, 0.0, yours)), 2, 0)
    assert found == pytest.approx(high, rel=5e-3)
    assert math.isfinite(found)
