"""The expert with lane changes: where it keeps its lane, where it goes on into the next one, and when it may not."""

import numpy as np
import pytest

from policies import layout as O
from service.training.expert import Expert, mean_action, noise_sd
from service.training.lane_changes import ChangingExpert

EXPERT = ChangingExpert()
LEFT, RIGHT = 1, -1


def driver(offset=0.0, sideways=0.0, speed=15.0, lanes=(1.0, 1.0)) -> np.ndarray:
    """One observation (1, 51) on an empty road; `sideways` in m/s to the left."""
    seen = np.zeros((1, O.OBSERVATION_SIZE))
    seen[0, O.LANE_OFFSET_M], seen[0, O.SPEED_MPS] = offset, speed
    seen[0, O.LANE_HEADING_RAD] = np.arcsin(sideways / speed)
    seen[0, O.LENGTH_M], seen[0, O.WIDTH_M] = 4.5, 1.8
    seen[0, O.LANE_TO_THE_LEFT : O.LANE_TO_THE_RIGHT + 1] = lanes
    seen[0, O.RANGE_M : O.RANGE_M + O.BEAMS] = O.LIDAR_RANGE_M
    return seen


def neighbour(seen: np.ndarray, beam: int, metres: float, rate: float = 0.0) -> np.ndarray:
    seen[0, O.RANGE_M + beam], seen[0, O.RANGE_RATE_MPS + beam] = metres, rate
    return seen


def test_slow_drift_is_corrected_and_fast_drift_goes_on():
    assert EXPERT.lateral_acceleration(driver(0.0, 0.15))[0] < 0.0
    assert EXPERT.lateral_acceleration(driver(0.6, 0.7))[0] > 0.0
    assert EXPERT.lateral_acceleration(driver(-0.6, -0.7))[0] < 0.0  # the same to the right


def test_no_lane_no_change():
    beside = EXPERT.lateral_acceleration(driver(0.6, 0.7, lanes=(0.0, 1.0)))[0]
    assert beside == pytest.approx(Expert(lateral_rate_per_s=0.42).lateral_acceleration(driver(0.6, 0.7))[0])


def test_a_crossed_marking_is_followed_by_the_lanes_middle():
    """From just behind the marking the lateral speed dies out before the middle: one change, not two."""
    offset, speed = -1.8, 0.8
    for _ in range(100):
        speed += 0.1 * EXPERT.lateral_acceleration(driver(offset, speed))[0]
        offset += 0.1 * speed
    assert abs(offset) < 0.2
    assert abs(speed) < 0.1


def test_a_neighbour_closes_its_side_only():
    abreast = neighbour(driver(), 5, 2.8)
    assert EXPERT.clear(abreast, LEFT)[0] < 0.01
    assert EXPERT.clear(abreast, RIGHT)[0] > 0.99
    two_lanes_away = neighbour(driver(), 5, 6.4)
    assert EXPERT.clear(two_lanes_away, LEFT)[0] > 0.99


def test_gaps_are_smaller_for_slower_traffic_and_larger_for_a_closing_neighbour():
    ahead = neighbour(driver(speed=15.0), 1, 11.0)
    assert EXPERT.clear(ahead, LEFT)[0] > 0.8
    assert EXPERT.clear(neighbour(driver(speed=15.0), 1, 11.0, rate=-4.0), LEFT)[0] < 0.2


def test_a_standing_vehicle_neither_turns_nor_changes():
    assert EXPERT.clear(driver(speed=0.5), LEFT)[0] < 0.05
    still = driver(speed=1e-9)
    assert noise_sd(EXPERT, still)[0, 1] == pytest.approx(0.0, abs=1e-9)
    assert np.isfinite(mean_action(EXPERT, still)).all()


def test_noise_grows_towards_the_threshold_where_the_side_is_clear():
    calm, moved = EXPERT.lateral_noise(driver())[0], EXPERT.lateral_noise(driver(0.3, 0.3))[0]
    hemmed_in = neighbour(driver(0.3, 0.3), 5, 2.5)
    assert moved > 1.5 * calm
    assert EXPERT.lateral_noise(hemmed_in)[0] == pytest.approx(calm, rel=0.05)
