import dataclasses

import numpy as np
import pytest

import ce
from service.analysis.comparison.differences import difference_of, mcnemar, of_pairs, pairs_of
from service.analysis.comparison.objects import Pairs

BASE = ce.Product([ce.Uniform(0.0, 1.0)])


def naive(f: np.ndarray, gamma: float, seed: int = 1) -> ce.Estimate:
    return ce.Estimate(
        gamma=gamma,
        method="naive",
        confidence=0.95,
        rollouts=f.size,
        training_rollouts=0,
        f=f,
        log_weights=None,
        proposal=BASE,
        finished=True,
        seed=seed,
    )


def test_with_many_events_it_is_the_normal_interval_of_the_pairs():
    u = np.random.default_rng(1).random(5000)
    a, b = naive(u, 0.10), naive(u + 0.001, 0.10)
    difference = difference_of(a, b)
    expected = ce.compare(b, a)
    assert (difference.how, difference.paired) == ("normal", True)
    assert difference.difference_ci == expected.difference_ci
    assert difference.difference == b.p - a.p < 0


def test_without_any_event_the_difference_still_has_a_width():
    f = np.random.default_rng(1).random(1000)
    none = difference_of(naive(f, -1.0, seed=1), naive(f, -1.0, seed=2))
    assert none.difference == 0.0
    assert none.difference_ci[0] < 0.0 < none.difference_ci[1]
    assert none.ratio is None
    assert none.ratio_ci == (0.0, None)
    assert not none.clear
    assert difference_of(naive(f, -1.0), naive(f, -1.0)).difference_ci[1] > 0.0


def test_what_both_share_cancels_where_events_are_few():
    u = np.random.default_rng(2).random(4000)
    a = naive(u, 0.005)
    same, other = difference_of(a, naive(u, 0.005)), difference_of(a, naive(u, 0.005, seed=9))
    assert (same.how, other.how) == ("paired counts", "bounds")
    assert same.difference_ci[1] < other.difference_ci[1]
    assert pairs_of(a, naive(u, 0.005)) is not None


@pytest.mark.parametrize("shared", [True, False])
def test_the_interval_holds_the_true_difference(shared):
    """300 comparisons of p = 0.004 and 0.008 by 1,000 rollouts each: bounds for few events hold it in 95% at least."""
    rng = np.random.default_rng(3)
    held = 0
    for k in range(300):
        u = rng.random(1000)
        v = u if shared else rng.random(1000)
        difference = difference_of(naive(u, 0.004, seed=1), naive(v, 0.008, seed=1 if shared else 2 + k))
        held += difference.difference_ci[0] <= 0.004 <= difference.difference_ci[1]
    assert held / 300 >= 0.95


def test_pairs_count_who_was_in_danger():
    a = naive(np.array([0.1, 0.1, 0.9, 0.9, 0.9]), 0.5)
    b = dataclasses.replace(a, f=np.array([0.1, 0.9, 0.1, 0.1, 0.9]))
    pairs = pairs_of(a, b)
    assert pairs is not None
    assert (pairs.both, pairs.only_a, pairs.only_b, pairs.neither) == (1, 1, 2, 1)


@pytest.mark.parametrize(
    "change", [{"seed": 2}, {"f": np.array([0.1, np.nan, 0.9])}, {"log_weights": np.zeros(3)}], ids=str
)
def test_there_are_no_pairs_where_the_draws_are_not_the_same_or_one_failed(change):
    a = naive(np.array([0.1, 0.1, 0.9]), 0.5)
    assert pairs_of(a, dataclasses.replace(a, **change)) is None


def test_on_the_same_draws_the_verdict_is_mcnemars():
    """8 draws dangerous to one alone against 24 to the other: the exact test tells them apart, and so do all intervals;
    the sides swapped give the same."""
    found = of_pairs(pairs_with(3, 8, 24), 0.95)
    assert found.clear
    assert found.difference == pytest.approx(16 / 4000)
    assert 0.0 < found.difference_ci[0] < found.difference < found.difference_ci[1]
    assert 1.0 < found.ratio_ci[0] < 27 / 11 < found.ratio_ci[1]
    assert mcnemar(8, 24) == pytest.approx(0.00700, abs=1e-5)
    turned = of_pairs(pairs_with(3, 24, 8), 0.95)
    assert turned.difference_ci == pytest.approx((-found.difference_ci[1], -found.difference_ci[0]))
    assert turned.ratio_ci == pytest.approx((1 / found.ratio_ci[1], 1 / found.ratio_ci[0]))


def test_difference_and_ratio_never_contradict_each_other():
    for both, only_a, only_b in ((0, 0, 0), (0, 0, 7), (5, 6, 7), (2, 9, 1), (0, 5, 0)):
        found = of_pairs(pairs_with(both, only_a, only_b), 0.95)
        low, high = found.ratio_ci
        apart = low > 1.0 or (high is not None and high < 1.0)
        assert found.clear == apart


def pairs_with(both: int, only_a: int, only_b: int) -> Pairs:
    return Pairs(both=both, only_a=only_a, only_b=only_b, neither=4000 - both - only_a - only_b)
