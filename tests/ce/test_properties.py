"""What holds for every family, every set of weights and every method, whatever the numbers."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import quad

import ce
from ce.results import Estimate
from tests.ce.resuming import resumed_at_every_step
from tests.reference.problems import BETAS, CORRELATED, LINEAR_2

BASE = ce.Product([ce.Normal([0.0], [[1.0]])])
few = settings(max_examples=25, deadline=None)


def numbers(low, high):
    return st.floats(low, high, allow_nan=False, allow_infinity=False)


shifts = numbers(-2.0, 2.0)
positive = numbers(0.3, 4.0)
marginals = st.one_of(
    st.builds(ce.Uniform, st.just(-1.0), numbers(0.0, 3.0), shifts),
    st.builds(ce.LogNormal, numbers(-1.0, 1.0), numbers(0.2, 1.2), shifts),
    st.builds(ce.Exponential, positive, numbers(-1.0, 1.0), shifts),
    st.builds(ce.Weibull, numbers(1.0, 4.0), positive, numbers(-1.0, 1.0), shifts),
    st.builds(ce.Gumbel, numbers(-1.0, 1.0), positive, shifts),
    st.builds(ce.TruncatedNormal, numbers(-1.0, 1.0), positive, st.just(-2.0), numbers(0.0, 3.0), shifts),
)
betas = st.builds(ce.Beta, numbers(1.0, 6.0), numbers(1.0, 6.0), numbers(-2.0, 0.0), numbers(1.0, 5.0))


@few
@given(st.one_of(marginals, betas))
def test_every_density_has_mass_one(block):
    product = ce.Product([block])
    if isinstance(block, ce.Beta):
        mass, _ = quad(lambda x: product.marginal_pdf(0, [x])[0], block.low, block.high, epsabs=1e-9)
    else:  # in standard-normal space, where no density has a pole: dx = T'(u) du

        def along(u):
            x = block.from_standard(np.array([u - 1e-5, u, u + 1e-5]))
            return math.exp(product.log_density(x[1:2, None])[0]) * (x[2] - x[0]) / 2e-5

        mass, _ = quad(along, -6.5, 6.5, limit=200)
    assert mass == pytest.approx(1.0, abs=2e-5)


@few
@given(betas, marginals, st.lists(numbers(-2.0, 2.0), min_size=2, max_size=2), numbers(-0.8, 0.8))
def test_the_gradient_of_the_log_partition_is_the_mean_of_the_statistics(beta, marginal, mean, r):
    cov = np.array([[1.0, r], [r, 1.5]])
    product = ce.Product([beta, ce.Normal(mean, cov), marginal])
    step = 1e-5
    # natural parameters: alpha, beta, Sigma^{-1} mu, shift; a step in each, through what with_parameters takes
    directions = np.eye(5) * step
    directions[2:4, 2:4] = cov * step  # d mu = Sigma d theta
    theta = product.parameters()
    gradient = [
        (
            product.with_parameters(theta + e).log_partition()
            - product.with_parameters(theta - e).log_partition()
        )
        / (2 * step)
        for e in directions
    ]
    np.testing.assert_allclose(gradient, product.mean_statistics(), atol=1e-5)


@few
@given(st.data())
def test_estimates_do_not_depend_on_the_order_of_the_rollouts(data):
    n = data.draw(st.integers(2, 200))
    source = np.random.default_rng(data.draw(st.integers(0, 10**6)))
    f = np.round(source.normal(size=n), 1)
    f[source.random(n) < 0.05] = np.nan
    log_w = source.normal(size=n) if data.draw(st.booleans()) else None
    order = source.permutation(n)

    def made(rows):
        return Estimate(
            gamma=0.0,
            method="any",
            confidence=0.9,
            rollouts=n,
            training_rollouts=0,
            f=f[rows],
            log_weights=None if log_w is None else log_w[rows],
            proposal=BASE,
            finished=True,
            base_f=f[rows],
        )

    a, b = made(np.arange(n)), made(order)
    assert (a.p, a.std_error, *a.ci, a.ess, a.max_weight_share) == pytest.approx(
        (b.p, b.std_error, *b.ci, b.ess, b.max_weight_share), rel=1e-12
    )
    gammas = [-1.0, 0.0, 0.5]
    np.testing.assert_allclose(a.curve(gammas).high, b.curve(gammas).high, rtol=1e-12)
    assert np.all(np.diff(a.curve(gammas).p) >= 0)
    assert a.ci[0] <= min(a.p, 1.0) <= a.ci[1]  # weights of no distribution may add up to more than one
    assert 1.0 - 1e-9 <= a.ess <= a.events + 1e-9 or a.events == 0


@settings(max_examples=10, deadline=None)
@given(
    st.sampled_from(ce.METHODS),
    st.sampled_from([LINEAR_2, BETAS, CORRELATED]),
    st.integers(0, 2**64 - 1),
    st.integers(1000, 6000),
    st.one_of(st.none(), numbers(0.05, 1.0)),
)
def test_every_method_resumes_at_every_step_to_the_same_bits(method, problem, seed, budget, rel_error):
    options = ce.general_options(budget, rel_error) if method == "ce" else None
    options = options or ce.OPTIONS[method](budget=budget, rel_error=rel_error)
    algorithm = ce.algorithm(method, problem.base, problem.gamma, options)
    steps = list(resumed_at_every_step(algorithm, problem.f, seed))
    asked = sum(len(batch.x) for batch, _ in steps)
    assert asked == algorithm.estimate(steps[-1][1]).rollouts <= budget
