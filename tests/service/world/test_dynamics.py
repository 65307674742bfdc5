"""Motion of a vehicle against closed forms."""

from __future__ import annotations

import math

import numpy as np
import pytest

from policies.layout import (
    MAX_ACCELERATION_MPS2,
    MAX_DECELERATION_MPS2,
    MAX_TURN_RATE_RADPS,
    MIN_TURN_RADIUS_M,
)
from service.world import agents as A
from service.world.sim.dynamics import advance

DT = 0.1


def vehicle(speed: float, heading: float = 0.0) -> np.ndarray:
    agent = np.zeros(A.COLUMNS)
    agent[A.SPEED_MPS], agent[A.HEADING_RAD] = speed, heading
    return agent


def drive(agent: np.ndarray, acceleration: float, turn_rate: float, steps: int, may_reverse: bool = False):
    for _ in range(steps):
        advance(agent, acceleration, turn_rate, DT, may_reverse)
    return agent


@pytest.mark.parametrize(("acceleration", "steps"), [(2.0, 50), (-1.5, 80), (0.0, 100)])
def test_constant_acceleration_covers_v_t_plus_half_a_t_squared(acceleration, steps):
    heading, t = 0.7, steps * DT
    agent = drive(vehicle(15.0, heading), acceleration, 0.0, steps)
    distance = 15.0 * t + 0.5 * acceleration * t * t
    assert agent[A.SPEED_MPS] == pytest.approx(15.0 + acceleration * t, rel=1e-12)
    assert agent[A.X_M] == pytest.approx(distance * math.cos(heading), rel=1e-12)
    assert agent[A.Y_M] == pytest.approx(distance * math.sin(heading), rel=1e-12)
    assert agent[A.HEADING_RAD] == heading


@pytest.mark.parametrize("turn_rate", [0.3, -0.3, 0.05])
def test_constant_turning_stays_on_its_circle_to_the_error_of_chords(turn_rate):
    """A step goes v dt along the chord's direction instead of the chord: too far by the factor (w dt)^2 / 24."""
    speed, steps = 12.0, 200
    agent = drive(vehicle(speed), 0.0, turn_rate, steps)
    radius, turned = speed / turn_rate, turn_rate * steps * DT
    exact = np.array([radius * math.sin(turned), radius * (1.0 - math.cos(turned))])
    factor = (turn_rate * DT / 2.0) / math.sin(turn_rate * DT / 2.0)
    assert agent[A.HEADING_RAD] == pytest.approx(turned, rel=1e-12)
    assert agent[[A.X_M, A.Y_M]] == pytest.approx(exact * factor, abs=1e-9)
    assert (
        np.abs(agent[[A.X_M, A.Y_M]] - exact).max() < 2.0 * abs(radius) * (turn_rate * DT) ** 2 / 24.0 + 1e-12
    )


@pytest.mark.parametrize(
    ("asked", "done"),
    [(100.0, MAX_ACCELERATION_MPS2), (-100.0, -MAX_DECELERATION_MPS2), (3.0, 3.0), (-7.9, -7.9)],
)
def test_acceleration_is_clipped(asked, done):
    agent = drive(vehicle(20.0), asked, 0.0, 1)
    assert agent[A.SPEED_MPS] == pytest.approx(20.0 + done * DT, rel=1e-14)
    assert agent[A.ACCELERATION_MPS2] == pytest.approx(done, rel=1e-12)


@pytest.mark.parametrize(
    ("asked", "done"), [(5.0, MAX_TURN_RATE_RADPS), (-5.0, -MAX_TURN_RATE_RADPS), (0.2, 0.2)]
)
def test_turn_rate_is_clipped(asked, done):
    agent = drive(vehicle(20.0), 0.0, asked, 1)
    assert agent[A.HEADING_RAD] == pytest.approx(done * DT, rel=1e-14)
    assert agent[A.TURN_RATE_RADPS] == done


def test_an_environment_vehicle_stops_and_does_not_reverse():
    agent = drive(vehicle(3.0), -2.0, 0.0, 40)
    assert agent[A.SPEED_MPS] == 0.0
    assert agent[A.X_M] == pytest.approx(3.0**2 / (2.0 * 2.0), rel=1e-12)
    assert agent[A.ACCELERATION_MPS2] == 0.0


def test_the_acceleration_as_applied_is_that_of_the_stop():
    agent = drive(vehicle(0.2), -8.0, 0.0, 1)
    assert agent[A.SPEED_MPS] == 0.0
    assert agent[A.ACCELERATION_MPS2] == pytest.approx(-2.0)


def test_an_ego_may_reverse():
    agent = drive(vehicle(1.0), -2.0, 0.0, 20, may_reverse=True)
    assert agent[A.SPEED_MPS] == pytest.approx(-3.0)
    assert agent[A.X_M] == pytest.approx(1.0 * 2.0 - 0.5 * 2.0 * 4.0, abs=1e-12)


def test_a_standing_vehicle_does_not_turn():
    agent = drive(vehicle(0.0, 0.4), -1.0, 0.3, 50)
    assert agent[A.HEADING_RAD] == 0.4
    assert agent[A.TURN_RATE_RADPS] == 0.0


@pytest.mark.parametrize("speed", [0.2, 1.0, -0.5])
def test_a_slow_vehicle_turns_no_sharper_than_its_turning_circle(speed):
    agent = drive(vehicle(speed), 0.0, 0.3, 1, may_reverse=True)
    assert agent[A.TURN_RATE_RADPS] == pytest.approx(abs(speed) / MIN_TURN_RADIUS_M)
