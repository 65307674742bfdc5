"""A block of independent standard normals is a Normal with the identity for its covariance, without the matrices."""

from __future__ import annotations

import numpy as np
import pytest

import ce
from ce.standard import from_standard, to_standard

D = 5
STANDARD = ce.Product([ce.Beta(2, 3), ce.StandardNormal(D)])
NORMAL = ce.Product([ce.Beta(2, 3), ce.Normal(np.zeros(D), np.eye(D))])


def shifted(base: ce.Product, by: float) -> ce.Product:
    parameters = base.parameters()
    parameters[2:] += by * np.arange(D)
    return base.with_parameters(parameters)


@pytest.mark.parametrize("by", [0.0, 0.3])
def test_it_says_and_draws_the_same_as_that_normal(by):
    standard, normal = shifted(STANDARD, by), shifted(NORMAL, by)
    x, noise = ce.draw(standard, 3, "estimate", 1, 10, 40)
    y, same_noise = ce.draw(normal, 3, "estimate", 1, 10, 40)
    np.testing.assert_allclose(x, y, atol=1e-11)
    assert noise.tolist() == same_noise.tolist()
    for of in ("natural", "mean_statistics", "log_partition"):
        np.testing.assert_allclose(getattr(standard, of)(), getattr(normal, of)(), atol=1e-12)
    np.testing.assert_allclose(standard.log_density(x), normal.log_density(x), atol=1e-12)
    np.testing.assert_allclose(standard.log_ratio(STANDARD, x), normal.log_ratio(NORMAL, x), atol=1e-12)
    assert standard.kl(STANDARD) == pytest.approx(normal.kl(NORMAL), abs=1e-12)
    assert standard.kl(NORMAL) == pytest.approx(normal.kl(NORMAL), abs=1e-12)
    np.testing.assert_allclose(to_standard(standard, x), to_standard(normal, x), atol=1e-11)
    np.testing.assert_allclose(from_standard(standard, to_standard(standard, x)), x, atol=1e-11)


@pytest.mark.parametrize("method", ["naive", "ce", "splitting"])
def test_methods_take_it_and_finds_the_known_answer(method):
    """P(sum of three of 30 standard normals <= -2 sqrt 3) = Phi(-2) = 0.02275."""
    base = ce.Product([ce.StandardNormal(30)])
    found = ce.estimate(
        lambda x: x[:, :3].sum(axis=1), base, -2.0 * np.sqrt(3.0), method, budget=6000, seed=2
    )
    assert abs(found.p - 0.0227501) < 5 * max(found.std_error, 1e-4)


def test_a_thousand_coordinates_cost_no_matrices():
    base = ce.Product([ce.StandardNormal(4000)])
    u = np.zeros((3, 4000))
    assert from_standard(base, u) is not None
    assert "cov" not in vars(base.blocks[0])


def test_wrong_use_is_named():
    for wrong in (0, -1, 2.5, True):
        with pytest.raises(ce.CeError, match="at least 1"):
            ce.StandardNormal(wrong)
    with pytest.raises(ce.CeError, match="finite"):
        ce.StandardNormal(2).with_mean(np.array([np.nan, 0.0]))
