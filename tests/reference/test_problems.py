"""The exact probabilities used in the tests, each computed again by an independent route."""

import math

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.special import gammainc, gammaincc

from tests.reference.problems import ALL, BETAS, CORRELATED, LINEAR_2, LINEAR_404


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


KNOWN = {problem.name: problem for problem in ALL}


def test_sums_of_exponentials_and_squares_are_gamma_tails():
    for d, c in ((20, 8.951), (404, 333.488553829)):
        assert gammainc(d, c) == pytest.approx(KNOWN[f"sum of {d} Exp(1) < {c:g}"].p, rel=1e-7)
    for t in (530, 560):
        assert gammaincc(202.0, t / 2) == pytest.approx(KNOWN[f"|x|^2 > {t}, d=404"].p, rel=1e-7)


def test_corners_are_products_of_normal_tails():
    for least in (2, 3):
        tail = 0.5 * math.erfc(least / math.sqrt(2))
        assert 2 * tail**2 == pytest.approx(KNOWN[f"min(|x|, y) >= {least}"].p, rel=1e-7)


@pytest.mark.parametrize("k", [6, 7])
def test_four_branches_by_quadrature(k):
    """In rotated coordinates s = (a + b) / sqrt 2, t = (a - b) / sqrt 2: safe where |s| < 3 + 0.2 t^2 and
    |t| < k / 2."""
    inside, _ = quad(
        lambda t: (
            math.exp(-0.5 * t * t) / math.sqrt(2 * math.pi) * math.erf((3 + 0.2 * t * t) / math.sqrt(2))
        ),
        -k / 2,
        k / 2,
        epsabs=1e-14,
    )
    assert 1.0 - inside == pytest.approx(KNOWN[f"four-branch k={k}"].p, rel=1e-7)


def test_rp25_by_quadrature():
    """For each x, y lies between (x^2 + 16) / 8 and 16 x - 32."""

    def density(x: float) -> float:
        low, high = (x * x + 16) / 8, 16 * x - 32
        between = 0.5 * (math.erfc(low / math.sqrt(2)) - math.erfc(high / math.sqrt(2)))
        return max(between, 0.0) * math.exp(-0.5 * x * x) / math.sqrt(2 * math.pi)

    p, _ = quad(density, 2.0, 12.0, epsabs=1e-15, limit=400)
    assert p == pytest.approx(KNOWN["RP25"].p, rel=1e-6)
