import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from ce.pareto import pareto_k
from ce.weights import effective_sample_size, max_share, normalised, order_statistic

LOG_WEIGHTS = arrays(np.float64, st.integers(1, 60), elements=st.floats(-2000, 2000))


@given(LOG_WEIGHTS, st.floats(-1000, 1000), st.randoms(use_true_random=False))
def test_weights_are_a_distribution_whatever_their_scale_and_order(log_weights, shift, random):
    w = normalised(log_weights)
    assert w.sum() == pytest.approx(1.0, rel=1e-12)
    assert np.all(w >= 0)
    order = list(range(log_weights.size))
    random.shuffle(order)
    # Adding the shift rounds the logarithms, by up to 3e-13.
    np.testing.assert_allclose(normalised(log_weights[order] + shift), w[order], rtol=1e-9, atol=1e-300)
    assert 1 - 1e-9 <= effective_sample_size(log_weights) <= log_weights.size * (1 + 1e-9)
    assert 1 / log_weights.size - 1e-9 <= max_share(log_weights) <= 1


def test_no_weights_give_nothing():
    assert effective_sample_size(np.zeros(0)) == 0
    assert max_share(np.zeros(0)) == 0
    assert normalised(np.zeros(0)).size == 0


@given(arrays(np.float64, st.integers(1, 60), elements=st.floats(allow_nan=False)), st.floats(0.001, 0.999))
def test_quantile_is_a_value_of_the_sample_with_enough_at_or_below_it(f, level):
    q = order_statistic(f, level)
    assert q in f
    assert np.count_nonzero(f <= q) >= level * f.size - 1e-6
    assert np.count_nonzero(f < q) < level * f.size + 1e-6 or q == f.min()


def test_quantile_of_infinities_is_infinite_and_of_nothing_nan():
    assert order_statistic(np.array([1.0, math.inf, math.inf]), 0.5) == math.inf
    assert math.isnan(order_statistic(np.zeros(0), 0.5))


@pytest.mark.parametrize("k", [0.2, 0.5, 0.9])
def test_pareto_k_finds_the_tail_index(k):
    rng = np.random.default_rng(0)
    found = [pareto_k(rng.pareto(1 / k, 20_000) + 1) for _ in range(20)]
    assert np.mean(found) == pytest.approx(k, abs=0.08)


def test_pareto_k_of_equal_or_few_weights():
    assert pareto_k(np.ones(1000)) == -math.inf
    assert math.isnan(pareto_k(np.ones(20)))
