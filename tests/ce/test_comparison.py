import math

import numpy as np
import pytest

import ce
from tests.reference.problems import LINEAR_2


def tail(beta):
    return 0.5 * math.erfc(beta / math.sqrt(2))


def naive(shift, seed=0, **more):
    return ce.estimate(
        lambda x: LINEAR_2.f(x) + shift, LINEAR_2.base, 1.5, "naive", budget=20_000, seed=seed, **more
    )


def test_common_random_numbers_narrow_the_difference():
    a, b = naive(0.0), naive(0.1)
    paired, apart = ce.compare(a, b), ce.compare(a, naive(0.1, seed=1))
    assert paired.paired
    assert not apart.paired
    assert paired.difference_std_error < 0.6 * apart.difference_std_error
    exact = tail(2.0) - tail(2.1)
    for found in (paired, apart):
        assert abs(found.difference - exact) < 4 * found.difference_std_error
        assert found.ratio_ci[0] < found.ratio < found.ratio_ci[1]


def test_intervals_cover_about_as_often_as_they_say():
    exact, ratio = tail(2.0) - tail(2.1), tail(2.0) / tail(2.1)
    found = [ce.compare(naive(0.0, seed), naive(0.1, seed)) for seed in range(60)]
    assert sum(c.difference_ci[0] <= exact <= c.difference_ci[1] for c in found) >= 50
    assert sum(c.ratio_ci[0] <= ratio <= c.ratio_ci[1] for c in found) >= 50


def test_methods_may_differ_and_nothing_may_have_been_found():
    est = ce.estimate(LINEAR_2.f, LINEAR_2.base, 1.5, "mixture", budget=5000)
    assert ce.compare(naive(0.0), est).ratio == pytest.approx(1.0, abs=0.2)
    none = ce.compare(naive(0.0), naive(9.0))
    assert math.isnan(none.ratio)
    assert none.ratio_ci == (0.0, math.inf)
    with pytest.raises(ce.OptionsError, match="confidence"):
        ce.compare(naive(0.0), naive(0.0, confidence=0.9))


def test_a_simultaneous_band_holds_the_whole_curve():
    gammas = np.linspace(0.5, 3.0, 26)
    exact = np.array([tail(3.5 - g) for g in gammas])
    held = wider = 0
    for seed in range(40):
        est = naive(0.0, seed)
        band, pointwise = est.simultaneous_curve(gammas), est.curve(gammas)
        held += bool(np.all((band.low <= exact) & (exact <= band.high)))
        wider += bool(np.all(band.high >= pointwise.high))
    assert held >= 36
    assert wider == 40


@pytest.mark.parametrize("method", ["naive", "ce", "mixture"])
def test_two_systems_share_one_search_and_its_rollouts(method):
    def a(x):
        return LINEAR_2.f(x)

    def b(x):
        return LINEAR_2.f(x) + 0.1 + 0.02 * np.sin(5.0 * x[:, 0])

    gamma = 1.5 if method == "naive" else 0.0
    beta = 3.5 - gamma
    est_a, est_b = ce.paired(a, b, LINEAR_2.base, gamma, method, budget=20_000, seed=3)
    assert est_a.p == pytest.approx(tail(beta), abs=4 * est_a.std_error)
    assert est_a.rollouts == est_b.rollouts <= 20_000
    both = ce.compare(est_a, est_b)
    assert both.paired
    assert both.difference > 0
    apart = math.hypot(est_a.std_error, est_b.std_error)
    assert both.difference_std_error < apart  # of two estimates that share no rollouts
    low, high = both.ratio_ci
    assert low < tail(beta) / tail(beta + 0.1) < high or abs(both.ratio - 1.4) < 0.2


def test_systems_cannot_be_paired_by_splitting():
    with pytest.raises(ce.OptionsError, match="paired"):
        ce.paired(LINEAR_2.f, LINEAR_2.f, LINEAR_2.base, 0.0, "splitting")
