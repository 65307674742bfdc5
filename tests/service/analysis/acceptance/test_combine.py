"""Joint intervals: closed forms, a planted mixture, coverage."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.special import gammaincinv

import ce
from service.analysis.acceptance.combine import ratio, sum_of_products
from service.analysis.acceptance.measured import of_estimate
from service.analysis.acceptance.quantity import counted, exactly, happened, sharper, tabled, told


def test_zero_events_leave_three_over_the_exposure():
    rollouts, each = 50_000, 2.0
    found = sum_of_products([(exactly(each), counted(0, rollouts))])
    assert found.value == found.lower(0.95) == 0.0
    assert found.upper(0.95) * rollouts / each == pytest.approx(3.00, abs=0.01)
    hours = happened(0, 1000.0)
    assert hours.upper(np.array([0.95]))[0] * 1000.0 == pytest.approx(-math.log(0.05))


def test_one_uncertain_number_keeps_its_own_interval():
    p = counted(7, 1000)
    low, high = ce.interval.clopper_pearson(7, 1000, 0.95)
    assert p.interval(0.95) == pytest.approx((float(low), float(high)))
    found = sum_of_products([(exactly(3.0), p)])
    assert found.interval(0.95) == pytest.approx((3.0 * float(low), 3.0 * float(high)), rel=2e-3)


def test_a_planted_mixture_has_the_rate_of_its_closed_form():
    """Three scenarios with counts that are exactly their expectations, and the interval of a normal approximation."""
    e, p, n = np.array([2.0, 1.0, 0.5]), np.array([0.01, 0.02, 0.05]), 40_000
    found = sum_of_products(
        [(exactly(float(a)), counted(round(float(q) * n), n)) for a, q in zip(e, p, strict=True)]
    )
    assert found.value == pytest.approx(float(e @ p))
    deviation = math.sqrt(float(np.sum(e**2 * p * (1.0 - p) / n)))
    low, high = found.interval(0.95)
    assert (low, high) == pytest.approx(
        (found.value - 1.96 * deviation, found.value + 1.96 * deviation), rel=3e-3
    )


def test_intervals_hold_the_rate_of_a_planted_mixture():
    """1,000 cases of three scenarios, one of which has hardly any event, with exposures that are measured, too: 95%
    intervals and bounds hold in 93% of them at least."""
    e, p, n = [2.0, 1.0, 0.5], [1e-3, 2e-4, 2e-2], [4000, 4000, 1500]
    truth = sum(a * q for a, q in zip(e, p, strict=True))
    rng = np.random.default_rng(7)
    inside = below = 0
    for _ in range(1000):
        terms = []
        for a, q, size in zip(e, p, n, strict=True):
            measured = a * math.exp(0.05 * rng.normal())
            spread = math.exp(1.96 * 0.05)
            exposure = told(measured, measured / spread, measured * spread, 0.95)
            terms.append((exposure, counted(int(rng.binomial(size, q)), size)))
        found = sum_of_products(terms)
        low, high = found.interval(0.95)
        inside += low <= truth <= high
        below += truth <= found.upper(0.95)
    assert inside >= 930
    assert below >= 930


def test_a_ratio_of_two_poisson_rates_has_the_exact_bounds():
    """10 events over 1,000 h against 20 over 1,000 h: Clopper and Pearson's bounds of 10 of 30, as odds."""
    found = ratio(sum_of_products([(exactly(1.0), happened(10, 1000.0))]), happened(20, 1000.0))
    assert found.value == pytest.approx(0.5)
    low, high = (float(end) for end in ce.interval.clopper_pearson(10, 30, 0.95))
    assert found.interval(0.95) == pytest.approx((low / (1.0 - low), high / (1.0 - high)), rel=0.02)


def test_people_without_a_crash_leave_the_ratio_open():
    found = ratio(sum_of_products([(exactly(1.0), happened(1, 10.0))]), happened(0, 100.0))
    assert math.isinf(found.upper(0.95))
    assert found.lower(0.95) > 0.0


def test_a_weighted_estimate_is_read_off_its_own_intervals():
    rng = np.random.default_rng(3)
    x = rng.normal(2.0, 1.0, 3000)
    estimate = ce.Estimate(
        gamma=0.0, method="ce", confidence=0.95, rollouts=3000, training_rollouts=0, f=2.0 - x,
        log_weights=-0.5 * x**2 + 0.5 * (x - 2.0) ** 2, proposal=ce.Product([ce.Normal([2.0], [[1.0]])]),
    )  # fmt: skip
    found = of_estimate(estimate)
    for confidence in (0.9, 0.95, 0.99):
        assert found.interval(confidence) == pytest.approx(
            replace(estimate, confidence=confidence).ci, rel=1e-3
        )
    u = np.linspace(0.001, 0.999, 999)
    assert np.all(np.diff(found.upper(u)) >= 0.0)
    assert np.all(np.diff(found.lower(u)) >= 0.0)
    assert np.all(found.lower(u) <= found.upper(u))


def test_a_table_of_gamma_bounds_is_close_to_them():
    found = tabled(
        5.0,
        lambda c: (float(gammaincinv(5.0, 0.5 - 0.5 * c)), float(gammaincinv(6.0, 0.5 + 0.5 * c))),
    )
    u = np.linspace(0.01, 0.99, 99)
    assert found.lower(u) == pytest.approx(gammaincinv(5.0, u), rel=0.06)
    exact = gammaincinv(6.0, u)
    assert found.upper(u[49:]) == pytest.approx(exact[49:], rel=0.015)  # the half that bounds are read off
    assert np.all(found.upper(u) >= 0.99 * exact)  # the other one is no smaller than it should be
    assert found.upper(u) == pytest.approx(exact, abs=0.65)


def test_what_is_told_has_the_interval_that_was_told():
    assert told(2.0, 1.0, 5.0, 0.95).interval(0.95) == pytest.approx((1.0, 5.0))
    assert told(0.0, 0.0, 3e-4, 0.95).interval(0.95) == pytest.approx((0.0, 3e-4))


def test_more_rollouts_that_say_the_same_narrow_the_interval():
    p = counted(40, 10_000)
    low, high = sharper(p, 100.0).interval(0.95)
    exact = counted(4000, 1_000_000).interval(0.95)
    assert (low, high) == pytest.approx(exact, rel=0.01)
    assert sharper(counted(0, 100), 10.0).interval(0.95)[1] == pytest.approx(
        counted(0, 1000).interval(0.95)[1], rel=0.03
    )
