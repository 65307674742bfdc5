"""The demonstrator on hand-made moments: what it brakes for, where it moves over, and what it lets be."""

import math

import numpy as np
import pytest

from service.errors import InputError
from service.training.demonstrator import (
    HARDEST_MPS2,
    NOTHING,
    avoid,
    demonstrated,
    is_attentive,
)
from service.training.expert import Expert, mean_action
from service.world import agents as A

LANE_M = 3.66


def moment(
    *others: tuple[float, float, float, float], speed: float = 20.0, offset: float = 0.0
) -> np.ndarray:
    """The ego in the middle of a straight road and others: metres ahead, metres to the left, m/s, m/s to the left."""
    agents = np.zeros((1 + len(others), A.COLUMNS))
    for row, (along, left, v, across) in zip(agents, [(0.0, 0.0, speed, 0.0), *others], strict=True):
        row[A.STATION], row[A.ALONG_M] = 100.0, along
        row[A.OFFSET_M], row[A.SPEED_MPS] = left, v
        row[A.LANE_HEADING_RAD] = math.asin(across / v) if v else 0.0
        row[A.LENGTH_M], row[A.WIDTH_M], row[A.ACTIVE] = 4.5, 1.8, 1.0
    agents[0, A.LANE_OFFSET_M] = offset
    return agents


def asked(*others: tuple[float, float, float, float], **ego: float) -> tuple[float, float]:
    return avoid(moment(*others, **ego), 0, 1.0)


def test_an_empty_road_and_a_neighbour_who_keeps_its_lane_ask_for_nothing():
    assert asked() == NOTHING
    assert asked((20.0, LANE_M, 15.0, 0.0), (0.0, -LANE_M, 20.0, 0.0)) == NOTHING
    assert asked((30.0, 0.0, 20.0, 0.0)) == NOTHING  # a leader at the same speed


def test_it_brakes_for_a_slower_vehicle_ahead_the_harder_the_nearer():
    far, near = asked((50.0, 0.0, 14.0, 0.0))[0], asked((20.0, 0.0, 14.0, 0.0))[0]
    assert near < -1.5
    assert near < far
    assert asked((8.0, 0.0, 5.0, 0.0))[0] == -HARDEST_MPS2


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_it_brakes_for_a_slower_vehicle_that_straddles_the_marking_and_moves_over(side):
    limit, push = asked((20.0, side * 0.5 * LANE_M, 14.0, 0.0))
    assert limit < -1.0
    assert side * push < -0.3


@pytest.mark.parametrize("drift", [0.2, 0.45])
def test_it_brakes_for_a_slower_neighbour_that_drifts_in(drift):
    """At 3 m/s less it is reached in 4 s and 3 s; until then it covers the room that was left."""
    left = 1.8 + 0.4 + 2.0 * drift
    assert asked((16.0, left, 16.0, -drift))[0] < -0.5
    assert asked((16.0, left, 16.0, drift))[0] == math.inf  # it drifts away
    assert asked((16.0, left, 20.0, -drift)) == NOTHING  # it is no slower


def test_it_falls_back_behind_one_who_comes_over_beside_it():
    limit, push = asked((3.0, 2.4, 20.0, -0.6))
    assert limit < 0.0
    assert push < 0.0


def test_it_moves_over_no_further_than_the_other_side_and_its_lane_allow():
    free = asked((0.0, 2.1, 20.0, 0.0))[1]
    assert free < -0.5
    assert asked((0.0, 2.1, 20.0, 0.0), (0.0, -2.2, 20.0, 0.0))[1] > 0.7 * free
    assert asked((0.0, 2.1, 20.0, 0.0), offset=-0.8)[1] == pytest.approx(0.0, abs=1e-12)


def test_it_is_symmetric():
    one, two = asked((14.0, 2.3, 15.0, -0.3)), asked((14.0, -2.3, 15.0, 0.3))
    assert one[0] == two[0]
    assert one[1] == -two[1]


def test_vehicles_that_have_left_are_not_there():
    agents = moment((8.0, 0.0, 5.0, 0.0))
    agents[1, A.ACTIVE] = 0.0
    assert avoid(agents, 0, 1.0) == NOTHING


def test_the_action_is_the_careful_drivers_where_nothing_is_asked():
    seen = np.abs(np.random.default_rng(3).normal(size=(20, 51))) * 10.0
    nothing = np.repeat([NOTHING], 20, axis=0)
    assert np.array_equal(demonstrated(Expert(), seen, nothing), mean_action(Expert(), seen))
    braking = demonstrated(Expert(), seen, np.repeat([(-6.0, 1.0)], 20, axis=0))
    assert braking[:, 0].max() <= -6.0
    assert (braking[:, 1] >= mean_action(Expert(), seen)[:, 1]).all()


def test_demonstrators_have_two_names():
    assert is_attentive("attentive")
    assert not is_attentive("careful")
    with pytest.raises(InputError, match="expected attentive or careful"):
        is_attentive("bold")
