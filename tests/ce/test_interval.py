import numpy as np
import pytest
from scipy.stats import binomtest, chi2

from ce.interval import clopper_pearson, weighted_gamma


@pytest.mark.parametrize(("k", "n"), [(0, 100), (1, 100), (37, 100), (100, 100), (3, 10**6)])
def test_clopper_pearson_agrees_with_scipy(k, n):
    expected = binomtest(k, n).proportion_ci(0.95, method="exact")
    low, high = clopper_pearson(k, n, 0.95)
    assert (float(low), float(high)) == pytest.approx((expected.low, expected.high), rel=1e-9)


def test_no_rollouts_say_nothing():
    assert tuple(float(v) for v in clopper_pearson(0, 0, 0.95)) == (0.0, 1.0)


@pytest.mark.parametrize("k", [1, 5, 200])
def test_gamma_interval_of_equal_weights_is_the_exact_poisson_interval(k):
    n, w = 10_000, 0.01
    low, high = weighted_gamma(k * w / n, k * w**2 / n**2, w / n, 0.95)
    assert float(low) == pytest.approx(w / n * chi2.ppf(0.025, 2 * k) / 2, rel=1e-9)
    assert float(high) == pytest.approx(w / n * chi2.ppf(0.975, 2 * (k + 1)) / 2, rel=1e-9)


def test_gamma_interval_without_events_is_an_upper_bound():
    low, high = weighted_gamma(0.0, 0.0, 1 / 1000, 0.95)
    assert float(low) == 0
    assert float(high) == pytest.approx(-np.log(0.025) / 1000, rel=1e-9)


def test_a_dominant_weight_widens_the_upper_end():
    even = weighted_gamma(1e-5, 1e-12, 1e-7, 0.95)[1]
    dominated = weighted_gamma(1e-5, 1e-12, 8e-6, 0.95)[1]
    assert float(dominated) > 2 * float(even)
