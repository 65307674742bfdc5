import numpy as np
import pytest
from scipy.stats import multivariate_normal

import ce
from ce.linear import Correlator, cholesky, solve

COV = np.array([[2.0, 0.6, -0.3], [0.6, 1.0, 0.2], [-0.3, 0.2, 0.5]])


@pytest.mark.parametrize(
    ("mean", "cov", "words"),
    [
        ([0.0, 0.0], [[1.0, 2.0], [2.0, 1.0]], "not positive definite"),
        ([0.0, 0.0], [[1.0, 1.0], [1.0, 1.0]], "not positive definite"),
        ([0.0], [[0.0]], "not positive definite"),
        ([0.0, 0.0], [[1.0, 0.5], [0.0, 1.0]], "symmetric"),
        ([0.0, 0.0], [[1.0]], "shape"),
        ([0.0, np.nan], np.eye(2), "finite"),
        ([[0.0]], [[1.0]], "shape"),
    ],
)
def test_impossible_parameters_are_refused(mean, cov, words):
    with pytest.raises(ce.FamilyError, match=words):
        ce.Normal(mean, cov)


def test_factor_and_solve_agree_with_numpy():
    rng = np.random.default_rng(0)
    g = rng.normal(size=(60, 80))
    a = g @ g.T
    np.testing.assert_allclose(cholesky(a), np.linalg.cholesky(a), rtol=1e-9, atol=1e-10)
    b = rng.normal(size=60)
    np.testing.assert_allclose(a @ solve(cholesky(a), b), b, rtol=1e-8, atol=1e-8)


def test_correlator_is_accurate_and_its_rows_do_not_depend_on_one_another_or_on_the_order_of_sums():
    rng = np.random.default_rng(1)
    g = rng.normal(size=(404, 500)) * rng.uniform(1e-3, 10, size=(404, 1))
    lower = cholesky(g @ g.T / 500)
    z = rng.standard_normal((300, 404))
    correlate = Correlator(lower)
    together = correlate(z)
    scale = np.sqrt(np.sum(lower**2, axis=1))
    assert np.abs((together - z @ lower.T) / scale).max() < 1e-10
    alone = np.concatenate([correlate(z[i : i + 7]) for i in range(0, 300, 7)])
    np.testing.assert_array_equal(together, alone)
    shuffled = rng.permutation(404)  # the same sums, added in another order
    other = Correlator(lower)
    other._high_t, other._low_t = other._high_t[shuffled], other._low_t[shuffled]
    np.testing.assert_array_equal(together, other(z[:, shuffled]))


def test_log_density_and_ratios_agree_with_scipy():
    rng = np.random.default_rng(2)
    p, q = ce.Normal([1.0, 2.0, 3.0], COV), ce.Normal([0.5, 2.5, 3.0], 1.3 * COV)
    shifted = p.with_mean(np.array([0.0, 2.0, 3.5]))
    x = rng.normal(size=(20, 3)) + 2
    expected = multivariate_normal(p.mean, COV).logpdf(x)
    np.testing.assert_allclose(p.log_density(x), expected, rtol=1e-10)
    np.testing.assert_allclose(
        p.log_ratio(q, x), expected - multivariate_normal(q.mean, q.cov).logpdf(x), rtol=1e-9
    )
    np.testing.assert_allclose(
        p.log_ratio(shifted, x),
        expected - multivariate_normal(shifted.mean, COV).logpdf(x),
        rtol=1e-9,
        atol=1e-9,
    )


def test_kl_between_covariances_is_the_mean_of_the_log_ratio():
    p, q = ce.Normal([1.0, 2.0, 3.0], COV), ce.Normal([0.5, 2.5, 3.0], 1.3 * COV)
    x = ce.draw(ce.Product([p]), 5, "estimate", 0, 0, 100_000)[0]
    ratio = p.log_ratio(q, x)
    assert abs(ratio.mean() - p.kl(q)) < 4 * ratio.std() / np.sqrt(ratio.size)
    assert p.kl(p.with_mean(p.mean)) == 0.0


def test_gradient_of_the_log_partition_is_the_mean():
    block = ce.Normal([1.0, -2.0, 0.5], COV)
    theta, h = block.precision_mean, 1e-6

    def log_partition(t):
        return 0.5 * t @ COV @ t

    assert block.log_partition() == pytest.approx(log_partition(theta), rel=1e-12)
    gradient = [(log_partition(theta + h * e) - log_partition(theta - h * e)) / (2 * h) for e in np.eye(3)]
    np.testing.assert_allclose(gradient, block.mean, rtol=1e-6)
