import numpy as np
import pytest
from scipy import stats

import ce

COV = np.array([[2.0, 0.6], [0.6, 1.0]])


@pytest.fixture
def product():
    return ce.Product(
        [ce.Beta(2, 3, -1, 4), ce.Normal([1.0, -2.0], COV), ce.Beta(4, 2), ce.Normal([0.5], [[0.25]])],
        names=["s", "xi0", "xi1", "t", "v"],
    )


def test_blocks_keep_their_columns(product):
    x, _ = ce.draw(product, 0, "estimate", 0, 0, 50_000)
    assert product.dim == 5
    assert x[:, 0].min() > -1
    assert x[:, 0].max() < 4
    np.testing.assert_allclose(x.mean(axis=0), [1.0, 1.0, -2.0, 4 / 6, 0.5], atol=0.03)
    np.testing.assert_allclose(np.cov(x[:, 1:3].T), COV, atol=0.06)


def test_density_has_natural_exponential_form(product):
    """log p(x) - theta . Gamma(x) + A(theta) is the carrier's density: the same for every theta."""
    x, _ = ce.draw(product, 0, "estimate", 0, 0, 20)
    moved = product.with_parameters(product.parameters() + np.linspace(0.1, 0.5, 7))
    carriers = [
        p.log_density(x) - p.statistics(x) @ p.natural() + p.log_partition() for p in (product, moved)
    ]
    np.testing.assert_allclose(carriers[0], carriers[1], rtol=1e-9, atol=1e-9)


def test_mean_statistics_are_the_means_of_the_statistics(product):
    x, _ = ce.draw(product, 1, "estimate", 0, 0, 200_000)
    gamma = product.statistics(x)
    z = (gamma.mean(axis=0) - product.mean_statistics()) / (gamma.std(axis=0) / np.sqrt(len(gamma)))
    assert np.abs(z).max() < 4


def test_log_ratio_is_the_difference_of_log_densities(product):
    moved = product.with_parameters(product.parameters() + np.linspace(0.1, 0.5, 7))
    x, _ = ce.draw(moved, 0, "train", 0, 0, 100)
    expected = product.log_density(x) - moved.log_density(x)
    np.testing.assert_allclose(product.log_ratio(moved, x), expected, rtol=1e-9, atol=1e-9)


def test_parameters_go_out_and_back_to_the_bit(product):
    wide = product.with_parameters(product.parameters(covariances=True))
    for p in (product, product.with_parameters(product.parameters()), wide):
        np.testing.assert_array_equal(p.parameters(True), product.parameters(True))
        assert p.names == product.names
    assert wide.normals[0][1].factor is product.normals[0][1].factor


def test_marginal_densities_agree_with_scipy(product):
    grid = np.linspace(-2, 6, 33)
    np.testing.assert_allclose(product.marginal_pdf(0, grid), stats.beta.pdf(grid, 2, 3, -1, 5), atol=1e-14)
    np.testing.assert_allclose(product.marginal_pdf(1, grid), stats.norm.pdf(grid, 1, 2**0.5), atol=1e-14)


def test_marginal_densities_integrate_to_one(product):
    for i in range(product.dim):
        low, high = product.marginal_range(i)
        grid = np.linspace(low, high, 4001)
        assert np.trapezoid(product.marginal_pdf(i, grid), grid) == pytest.approx(1.0, abs=1e-3)


def test_weights_have_mean_one_under_the_proposal(product):
    moved = product.with_parameters(product.parameters() + np.array([0.3, 0.1, -0.2, 0.2, 0.3, -0.2, 0.1]))
    x, _ = ce.draw(moved, 3, "train", 0, 0, 100_000)
    w = np.exp(product.log_ratio(moved, x))
    assert abs(w.mean() - 1) < 4 * w.std() / np.sqrt(w.size)


def test_wrong_use_is_named(product):
    with pytest.raises(ce.FamilyError, match="at least one block"):
        ce.Product([])
    with pytest.raises(ce.FamilyError, match="blocks"):
        ce.Product(["beta"])
    with pytest.raises(ce.FamilyError, match="label all"):
        ce.Product([ce.Beta(2, 2)], names=["a", "b"])
    with pytest.raises(ce.FamilyError, match="shape"):
        product.log_density(np.zeros((3, 4)))
    with pytest.raises(ce.FamilyError, match="finite"):
        product.log_density(np.full((1, 5), np.nan))
    with pytest.raises(ce.FamilyError, match="coordinate"):
        product.marginal_pdf(5, [0.0])
    with pytest.raises(ce.FamilyError, match="parameters"):
        product.with_parameters([1.0])
