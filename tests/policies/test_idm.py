"""The lane-keeping intelligent driver against its formula and in closed loop."""

from __future__ import annotations

import math

import numpy as np
import pytest

from policies import idm, layout
from policies.idm import idm_action, lane_keeping_turn_rate, leader_gap

WANTED_MPS = 25.0
BEAM_RAD = 2.0 * math.pi / layout.BEAMS


def alone(speed: float = 15.0, **values: float) -> np.ndarray:
    """An observation with nobody around; `values` by the names of policies.layout, in lower case."""
    observation = np.zeros(layout.OBSERVATION_SIZE)
    observation[layout.SPEED_MPS] = speed
    observation[layout.LENGTH_M] = 4.5
    observation[layout.WIDTH_M] = 1.8
    observation[layout.RANGE_M : layout.RANGE_M + layout.BEAMS] = layout.LIDAR_RANGE_M
    for name, value in values.items():
        observation[getattr(layout, name.upper())] = value
    return observation


def with_hit(observation: np.ndarray, beam: int, range_m: float, rate_mps: float) -> np.ndarray:
    observation[layout.RANGE_M + beam % layout.BEAMS] = range_m
    observation[layout.RANGE_RATE_MPS + beam % layout.BEAMS] = rate_mps
    return observation


def formula(speed: float, gap: float, closing: float) -> float:
    """Treiber, Hennecke, Helbing (2000), equations 2 and 3, with this module's parameters."""
    root = 2.0 * math.sqrt(idm.MAXIMUM_ACCELERATION_MPS2 * idm.COMFORTABLE_DECELERATION_MPS2)
    wanted = idm.MINIMUM_GAP_M + max(0.0, speed * idm.TIME_HEADWAY_S + speed * closing / root)
    return idm.MAXIMUM_ACCELERATION_MPS2 * (1.0 - (speed / WANTED_MPS) ** 4 - (wanted / gap) ** 2)


def test_a_free_road_is_taken_at_the_wanted_speed():
    assert idm_action(alone(WANTED_MPS), WANTED_MPS)[0] == 0.0
    assert idm_action(alone(0.0), WANTED_MPS)[0] == idm.MAXIMUM_ACCELERATION_MPS2
    assert idm_action(alone(30.0), WANTED_MPS)[0] < 0.0


@pytest.mark.parametrize(
    ("speed", "range_m", "rate"), [(15.0, 40.0, -5.0), (20.0, 60.0, 0.0), (5.0, 12.0, 3.0)]
)
def test_a_leader_is_followed_as_the_formula_says(speed, range_m, rate):
    observation = with_hit(alone(speed), 0, range_m, rate)
    expected = formula(speed, range_m - 0.5 * 4.5, -rate)
    assert idm_action(observation, WANTED_MPS)[0] == pytest.approx(expected, rel=1e-12)


def test_the_gap_is_measured_from_the_own_bumper():
    assert leader_gap(with_hit(alone(), 0, 30.0, -4.0)) == (30.0 - 2.25, 4.0)


def test_nobody_ahead_is_an_infinite_gap():
    assert leader_gap(alone()) == (math.inf, 0.0)


def test_the_nearest_of_several_hits_is_the_leader():
    observation = with_hit(with_hit(alone(), 0, 20.0, -1.0), 1, 4.0, -3.0)
    gap, closing = leader_gap(observation)
    assert gap == pytest.approx(4.0 * math.cos(BEAM_RAD) - 2.25, rel=1e-14)
    assert closing == pytest.approx(3.0 * math.cos(BEAM_RAD), rel=1e-14)


@pytest.mark.parametrize("beam", [1, 2, -1, -2])
def test_a_hit_outside_the_own_path_is_no_leader(beam):
    just_outside = (idm.CORRIDOR_HALF_WIDTH_M + 0.01) / abs(math.sin(beam * BEAM_RAD))
    just_inside = (idm.CORRIDOR_HALF_WIDTH_M - 0.01) / abs(math.sin(beam * BEAM_RAD))
    assert leader_gap(with_hit(alone(), beam, just_outside, -5.0))[0] == math.inf
    assert leader_gap(with_hit(alone(), beam, just_inside, -5.0))[0] < math.inf


@pytest.mark.parametrize("beam", range(3, 18))
def test_beams_to_the_sides_and_back_find_no_leader(beam):
    assert leader_gap(with_hit(alone(), beam, 1.0, -10.0))[0] == math.inf


def test_braking_stays_within_what_a_car_can_do_even_inside_another_one():
    for range_m in (0.0, 1.0, 2.25, 3.0):
        acceleration, _ = idm_action(with_hit(alone(20.0), 0, range_m, -20.0), WANTED_MPS)
        assert acceleration == -layout.MAX_DECELERATION_MPS2


def test_steering_turns_back_to_the_lane():
    assert lane_keeping_turn_rate(alone(lane_offset_m=0.5)) < 0.0
    assert lane_keeping_turn_rate(alone(lane_offset_m=-0.5)) > 0.0
    assert lane_keeping_turn_rate(alone(lane_heading_rad=0.1)) < 0.0
    assert lane_keeping_turn_rate(alone(lane_heading_rad=-0.1)) > 0.0


def test_steering_is_symmetric_to_the_bit():
    left = alone(lane_offset_m=0.4, lane_heading_rad=0.05, lane_curvature_per_m=1e-3)
    right = alone(lane_offset_m=-0.4, lane_heading_rad=-0.05, lane_curvature_per_m=-1e-3)
    assert lane_keeping_turn_rate(left) == -lane_keeping_turn_rate(right)


def test_a_centred_vehicle_turns_with_its_lane():
    assert lane_keeping_turn_rate(alone(20.0, lane_curvature_per_m=2e-3)) == pytest.approx(0.04, rel=1e-14)


@pytest.mark.parametrize("speed", [1.0, 3.0, 8.0, 20.0, 35.0])
def test_a_lane_offset_is_removed_without_swinging_over(speed):
    offset, heading, dt = 1.5, 0.0, 0.1
    offsets = []
    for _ in range(600):
        turn = lane_keeping_turn_rate(alone(speed, lane_offset_m=offset, lane_heading_rad=heading))
        offset += speed * dt * math.sin(heading + 0.5 * turn * dt)
        heading += turn * dt
        offsets.append(offset)
    assert abs(offsets[-1]) < 0.02
    assert min(offsets) > -0.3
    assert max(offsets) <= 1.5
