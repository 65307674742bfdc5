import numpy as np
import pytest

import ce
from ce.interval import clopper_pearson
from service.analysis.failures.shares import mode_estimate, share_interval


@pytest.mark.parametrize(("k", "n"), [(0, 12), (3, 12), (12, 12), (1, 400)])
def test_of_equal_weights_it_is_clopper_and_pearsons(k, n):
    member = np.arange(n) < k
    share, low, high = share_interval(member, np.full(n, 0.3), 0.95)
    expected = clopper_pearson(k, n, 0.95)
    assert share == pytest.approx(k / n)
    assert (low, high) == pytest.approx((float(expected[0]), float(expected[1])), abs=1e-9)


def test_the_interval_of_weighted_events_holds_the_share():
    """500 samples of 60 weighted events with a true share of 0.3: 95% intervals hold it in 93% at least."""
    rng = np.random.default_rng(7)
    held = 0
    for _ in range(500):
        member = rng.random(60) < 0.3
        weight = np.exp(rng.normal(size=60))
        _, low, high = share_interval(member, weight, 0.95)
        held += low <= 0.3 <= high
    assert held / 500 >= 0.93


def test_one_heavy_event_makes_the_interval_wide():
    member = np.array([True, False, False, False])
    _, low, high = share_interval(member, np.array([1.0, 1e-6, 1e-6, 1e-6]), 0.95)
    assert low < 0.2
    assert high > 0.99


def test_no_event_says_nothing():
    assert share_interval(np.zeros(0, bool), np.zeros(0), 0.95) == (0.0, 0.0, 1.0)


def test_the_modes_probabilities_add_up_to_p():
    base = ce.Product([ce.Normal(np.zeros(3), np.eye(3))])
    estimate = ce.estimate(lambda x: x.sum(axis=1), base, -3.0, method="ce", budget=4000, seed=3)
    rows = np.flatnonzero(estimate.f <= estimate.gamma)
    whole = estimate.f.size
    parts = [mode_estimate(estimate, rows[rows % 3 == k], whole) for k in range(3)]
    assert sum(part.p for part in parts) == pytest.approx(estimate.p)
    assert all(part.ci[0] <= part.p <= part.ci[1] for part in parts)
    stop = int(rows[50])
    early = mode_estimate(estimate, rows[:50], stop)
    assert early.f.size == stop
    assert early.events == 50
