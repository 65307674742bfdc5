"""IDM+MOBIL: the model's equations, and fits that find known parameters again."""

import numpy as np
import pytest

from policies.baselines import fit as B
from policies.baselines.idm_mobil import PARAMETERS, change_rate, following, incentive, steering
from policies.data.scenes import DataError

VALUES = np.array([25.0, 1.2, 2.0, 1.0, 2.0, 0.2, 0.3, 0.2, 0.1, 0.5, 4.0, 0.6])


def test_following_is_the_intelligent_driver_model():
    assert following(VALUES, 25.0, 1e6, 0.0) == pytest.approx(0.0, abs=1e-6)
    assert following(VALUES, 0.0, 1e6, 0.0) == pytest.approx(1.0)
    wanted = 2.0 + 1.2 * 10.0 + 10.0 * 3.0 / (2.0 * np.sqrt(2.0))
    expected = 1.0 - (10.0 / 25.0) ** 4 - (wanted / 20.0) ** 2
    assert following(VALUES, 10.0, 20.0, 3.0) == pytest.approx(expected)
    assert following(VALUES, 20.0, 1.0, 10.0) == -8.0


def test_an_incentive_is_the_gain_behind_the_new_leader():
    station = np.array([100.0, 112.0, 160.0, 60.0])  # me, leader, leader in the other lane, follower there
    lane, speed = np.array([1, 1, 0, 0]), np.array([10.0, 8.0, 10.0, 10.0])
    length, present = np.full(4, 4.5), np.ones(4, dtype=bool)
    own, others, allowed = incentive(VALUES, station, lane, speed, length, present, 0, 0)
    now = following(VALUES, 10.0, 7.5, 2.0)
    then = following(VALUES, 10.0, 55.5, 0.0)
    assert own == pytest.approx(min(then - now, 2.0))
    after, before = following(VALUES, 10.0, 35.5, 0.0), following(VALUES, 10.0, 95.5, 0.0)
    assert others == pytest.approx(after - before)
    assert allowed
    station[3] = 96.0
    assert not incentive(VALUES, station, lane, speed, length, present, 0, 0)[2]


def test_a_change_is_the_likelier_the_more_it_gains():
    rates = [change_rate(VALUES, gain, 0.0, False) for gain in (-2.0, 0.3, 2.0)]
    assert rates[1] == pytest.approx(0.05)
    assert rates[0] < 1e-5
    assert rates[2] == pytest.approx(0.1, rel=1e-3)
    assert change_rate(VALUES, 0.8, 0.0, True) == pytest.approx(0.05)


def test_steering_returns_to_the_lane():
    assert steering(VALUES, 10.0, 1.0, 0.0, 0.0) < 0.0 < steering(VALUES, 10.0, -1.0, 0.0, 0.0)
    assert steering(VALUES, 10.0, 0.0, 0.0, 0.01) == pytest.approx(0.1)


def simulated_events(idm, count=12, steps=120, seed=1):
    rng = np.random.default_rng(seed)
    v0, headway, standstill, a, b = idm
    events = np.empty((count, steps, 3))
    for event in events:
        lead = np.clip(8.0 + np.cumsum(rng.normal(0.0, 0.25, steps)), 1.0, 20.0)
        gap, v = rng.uniform(8.0, 25.0), lead[0]
        for k in range(steps):
            event[k] = gap, v, lead[k]
            wanted = standstill + max(0.0, headway * v + v * (v - lead[k]) / (2.0 * np.sqrt(a * b)))
            accel = a * (1.0 - (v / v0) ** 4 - (wanted / max(gap, 0.5)) ** 2)
            new = max(v + np.clip(accel, -8.0, 4.0) * 0.1, 0.0)
            following_lead = lead[min(k + 1, steps - 1)]
            gap = max(gap + 0.1 * (0.5 * (following_lead + lead[k]) - 0.5 * (v + new)), 0.1)
            v = new
    return events


def test_car_following_parameters_are_found_again():
    truth = np.array([24.0, 1.5, 2.5, 1.2, 1.5])
    events = simulated_events(truth)
    assert B.spacing_error(truth, events) < 1e-12
    found, error = B.fit_following(events, 150)
    before = np.sqrt(B.spacing_error(np.array(B.STARTS[0]), events))
    assert error < min(0.1 * before, 0.03)
    # headway and standstill gap trade off; the gap that they want at the events' speed does not
    assert found[2] + 8.0 * found[1] == pytest.approx(2.5 + 8.0 * 1.5, rel=0.1)


def test_nothing_to_follow_is_refused():
    with pytest.raises(DataError, match="needs car-following events"):
        B.fit(np.zeros((0, 10, 3)), [])
    assert len(PARAMETERS) == len(VALUES)
