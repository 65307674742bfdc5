import numpy as np
import pytest
from scipy.integrate import quad
from scipy.stats import beta as scipy_beta

import ce
from ce.beta import BetaColumns


@pytest.mark.parametrize(
    "arguments", [(0, 1), (1, -2), (np.nan, 1), (1, np.inf), (2, 2, 1, 1), (2, 2, 0, np.inf)]
)
def test_impossible_parameters_are_refused(arguments):
    with pytest.raises(ce.FamilyError):
        ce.Beta(*arguments)


def test_log_density_agrees_with_scipy_and_integrates_to_one():
    columns = BetaColumns.of([ce.Beta(2.5, 3.5, -3.6, 3.6)])
    x = np.linspace(-3.5, 3.5, 15)
    expected = scipy_beta.logpdf(x, 2.5, 3.5, -3.6, 7.2)
    np.testing.assert_allclose(columns.log_density(x[:, None]), expected, rtol=1e-12, atol=1e-12)
    area, _ = quad(lambda t: float(np.exp(columns.log_density(np.array([[t]])))[0]), -3.6, 3.6)
    assert area == pytest.approx(1.0, rel=1e-8)


def test_gradient_of_the_log_partition_agrees_with_finite_differences():
    rng = np.random.default_rng(0)
    alpha, beta = rng.uniform(0.5, 20, 50), rng.uniform(0.5, 20, 50)
    zero, one, h = np.zeros(50), np.ones(50), 1e-5

    def log_partition(a, b):
        return BetaColumns(a, b, zero, one).log_partition()

    by_alpha, by_beta = BetaColumns(alpha, beta, zero, one).mean_statistics()
    np.testing.assert_allclose(
        by_alpha, (log_partition(alpha + h, beta) - log_partition(alpha - h, beta)) / (2 * h), rtol=1e-6
    )
    np.testing.assert_allclose(
        by_beta, (log_partition(alpha, beta + h) - log_partition(alpha, beta - h)) / (2 * h), rtol=1e-6
    )


def test_a_value_at_an_end_of_the_interval_has_a_finite_density_and_one_outside_is_refused():
    product = ce.Product([ce.Beta(2, 2, 0, 40)])
    assert np.all(np.isfinite(product.log_density([[0.0], [40.0]])))
    with pytest.raises(ce.FamilyError, match="outside"):
        product.log_density([[40.1]])


def test_kl_is_the_mean_of_the_log_ratio():
    p, q = (BetaColumns.of([ce.Beta(a, b)]) for a, b in ((2.0, 5.0), (3.0, 1.5)))
    x = p.sample(np.random.default_rng(1), 400_000)
    ratio = p.log_density(x) - q.log_density(x)
    assert abs(ratio.mean() - p.kl(q)) < 4 * ratio.std() / np.sqrt(ratio.size)
