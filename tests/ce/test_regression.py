"""The direction in which f falls, from a whole batch."""

import math

import numpy as np
import pytest

from ce.regression import downhill

D = 200
TRUE = np.ones(D) / math.sqrt(D)


def batch(n, seed=0):
    return np.random.default_rng(seed).normal(size=(n, D))


def test_a_linear_f_is_recovered_exactly():
    u = batch(400)
    found = downhill(u, 3.0 - 2.0 * (u @ TRUE))
    assert found.vector @ TRUE == pytest.approx(1.0, abs=1e-6)
    assert found.cosine2 == pytest.approx(1.0, abs=1e-6)


@pytest.mark.parametrize("g", [np.exp, np.tanh, lambda s: np.maximum(s, -0.5)], ids=["exp", "tanh", "kink"])
def test_any_monotone_f_of_one_direction_is_recovered(g):
    u = batch(3000)
    found = downhill(u, -g(u @ TRUE))
    assert found.vector @ TRUE > 0.85
    assert found.cosine2 == pytest.approx((found.vector @ TRUE) ** 2, abs=0.08)


def test_infinities_and_failures_are_left_out():
    u = batch(1500)
    f = 1.0 - u @ TRUE
    f[:300] = np.inf
    f[300:400] = np.nan
    assert downhill(u, f).vector @ TRUE > 0.999


def test_nothing_is_claimed_from_noise_or_from_too_few_rows():
    u = batch(2000)
    assert downhill(u, np.random.default_rng(1).normal(size=2000)) is None
    assert downhill(u, np.sum(u * u, axis=1)) is None
    assert downhill(u, np.ones(2000)) is None
    assert downhill(u[:150], u[:150] @ TRUE) is None


def test_what_a_row_adds_to_its_own_projection_is_known():
    """Left out of the regression, its projection is that less its influence."""
    u = batch(600)
    f = -(u @ TRUE) + np.random.default_rng(2).normal(size=600)
    found = downhill(u, f)
    for i in (0, 17, 300):
        others = np.delete(np.arange(600), i)
        without = downhill(u[others], f[others])
        corrected = u[i] @ found.vector - found.influence[i]
        assert corrected == pytest.approx(u[i] @ without.vector, abs=0.06)
