"""A level beside f: it is climbed, and decides nothing."""

import numpy as np
import pytest

import ce

BASE = ce.Product([ce.Normal(np.zeros(2), np.eye(2))])
P = 3.1671241833119857e-05  # Phi(-4)


def blind(x):
    """Says nothing before the event happens."""
    return np.where(x[:, 0] >= 4.0, -1.0, 1.0)


def distance(x):
    return 4.0 - x[:, 0]


def test_splitting_climbs_the_level_to_an_event_that_f_does_not_announce():
    runs = [
        ce.estimate(blind, BASE, 0.0, "splitting", budget=10_000, seed=s, level=distance) for s in range(8)
    ]
    p = np.array([e.p for e in runs])
    assert abs(p.mean() - P) < 4.0 * p.std(ddof=1) / np.sqrt(8)
    assert p.std(ddof=1) < 0.5 * np.sqrt(P / 10_000)
    assert all(e.ci[0] <= P <= e.ci[1] for e in runs)


def test_a_level_that_is_f_orders_rollouts_as_f_does():
    f = np.array([3.0, -2.0, np.inf, 0.4, 0.51, np.nan])
    both = ce.levelled(f, f, 0.5)
    assert np.array_equal(both <= 0.5, f <= 0.5)
    rest = ~(f <= 0.5) & ~np.isnan(f)
    assert np.array_equal(np.argsort(both[rest]), np.argsort(f[rest]))
    assert both[1] == -2.0
    assert np.isinf(both[2])
    assert np.isnan(both[5])


def test_a_low_level_is_no_event():
    assert np.all(ce.levelled([1.0, 1.0, 1.0], [-np.inf, -1e300, 0.0], 0.5) > 0.5)


def test_a_level_of_another_shape_is_refused():
    with pytest.raises(ce.ResponseError, match="level must give shape"):
        ce.estimate(blind, BASE, 0.0, budget=1000, level=lambda x: 1.0)
