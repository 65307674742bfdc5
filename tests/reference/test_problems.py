"""The exact probabilities used in the tests, each computed again by an independent route."""

import math

import numpy as np
import pytest
from scipy.integrate import quad

from tests.reference.problems import BETAS, CORRELATED, LINEAR_2, LINEAR_404


@pytest.mark.parametrize(("beta", "p"), [(3.5, LINEAR_2.p), (3.5, LINEAR_404.p), (4.5, CORRELATED.p)])
def test_linear_problems_are_normal_tails(beta, p):
    density_integral, _ = quad(lambda t: math.exp(-0.5 * t * t) / math.sqrt(2 * math.pi), beta, 40, epsabs=0)
    assert 0.5 * math.erfc(beta / math.sqrt(2)) == pytest.approx(p, rel=1e-6)
    assert density_integral == pytest.approx(p, rel=1e-6)


@pytest.mark.parametrize("problem", [LINEAR_2, LINEAR_404, CORRELATED], ids=lambda q: q.name)
def test_linear_limit_states_are_standard_normal_under_the_base(problem):
    """f is affine, so the sign of its gradient in the base's metric settles beta: |L^T grad f| must be 1."""
    start, block = problem.base.normals[0]
    at_mean = np.array(
        [0.5 * (b.low + b.high) if hasattr(b, "low") else 0.0 for b in problem.base.blocks[:-1]]
    )
    origin = np.concatenate([at_mean, block.mean])
    steps = np.eye(problem.base.dim)[start:]
    gradient = problem.f(origin + steps) - problem.f(origin[None, :])
    assert np.linalg.norm(np.linalg.cholesky(block.cov).T @ gradient) == pytest.approx(1.0, rel=1e-12)
    beta = problem.f(origin[None, :])[0] - problem.gamma
    assert 0.5 * math.erfc(beta / math.sqrt(2)) == pytest.approx(problem.p, rel=1e-6)


def test_beta_problem_is_a_power_of_one_marginal():
    one, _ = quad(lambda u: 6 * u * (1 - u), 0, 0.2)
    assert one**5 == pytest.approx(BETAS.p, rel=1e-7)
    assert pytest.approx(BETAS.p, rel=1e-7) == (3 * 0.2**2 - 2 * 0.2**3) ** 5
