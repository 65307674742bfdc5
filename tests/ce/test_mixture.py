import math

import numpy as np
import pytest

import ce
from ce.gaussian_mixture import Mixture, Part, draw_standard, log_ratio
from ce.mixture_fit import fit
from ce.standard import from_standard, to_standard
from ce.subspace import find
from tests.ce.resuming import resumed_at_every_step
from tests.reference import traffic
from tests.reference.problems import ALL, BETAS, CORRELATED, LINEAR_2


def mixture(d=6, r=2, k=3, seed=0):
    source = np.random.default_rng(seed)
    basis = np.linalg.qr(source.normal(size=(d, r)))[0]
    factors = np.stack([np.linalg.cholesky(np.eye(r) * s + 0.2) for s in (0.3, 0.8, 1.5)[:k]])
    shares = np.array([0.5, 0.3, 0.2])[:k] / np.array([0.5, 0.3, 0.2])[:k].sum()
    return Mixture(0.1, (Part(0.9, basis, shares, source.normal(size=(k, r)), factors, 0.9),))


def test_mixture_density_is_that_of_its_draws():
    """E_q[phi / q] = 1 for any q, and a histogram along any direction agrees with the density's moments."""
    q = mixture()
    u = draw_standard(q, 6, 3, "train", 0, 0, 200_000)
    w = np.exp(-log_ratio(q, u))
    assert abs(w.mean() - 1.0) < 4 * w.std() / math.sqrt(w.size)
    second = w @ (u * u) / w.size
    assert np.abs(second - 1.0).max() < 0.05
    assert w.max() <= 1.0 / q.base_share + 1e-9


def test_rows_do_not_depend_on_the_range_asked_for():
    q = mixture()
    u = draw_standard(q, 6, 3, "estimate", 2, 0, 2500)
    np.testing.assert_array_equal(draw_standard(q, 6, 3, "estimate", 2, 990, 2010), u[990:2010])


def test_standard_space_and_back():
    base = CORRELATED.base
    u = np.random.default_rng(0).normal(size=(2000, base.dim)) * 2.0
    np.testing.assert_allclose(to_standard(base, from_standard(base, u)), u, atol=1e-6)
    x = from_standard(base, np.random.default_rng(1).normal(size=(100_000, base.dim)))
    drawn, _ = ce.draw(base, 0, "train", 0, 0, 100_000)
    for i in range(base.dim):
        np.testing.assert_allclose(
            np.quantile(x[:, i], [0.1, 0.5, 0.9]), np.quantile(drawn[:, i], [0.1, 0.5, 0.9]), atol=0.03
        )


@pytest.mark.parametrize("dense", [True, False], ids=["all coordinates", "three coordinates"])
def test_noise_moves_nothing_and_a_signal_is_found(dense):
    source = np.random.default_rng(0)
    u = source.normal(size=(2000, 300))
    even = np.full(2000, 1 / 2000)
    assert find(u, even).basis.shape[1] <= 1
    assert find(u, even).scale == 1.0
    direction = np.ones(300) / math.sqrt(300) if dense else np.eye(300)[:3].sum(axis=0) / math.sqrt(3)
    space = find(u + 2.5 * direction, even)
    assert np.linalg.norm(space.basis.T @ direction) > 0.95
    # What the samples say of the direction they made is corrected: no optimism.
    length = np.linalg.norm(even @ space.y)
    assert length == pytest.approx(2.5, abs=0.15)


def test_two_opposite_modes_in_high_dimension_are_found():
    source = np.random.default_rng(0)
    direction = np.ones(200) / math.sqrt(200)
    u = source.normal(size=(1500, 200))
    u += np.outer(np.where(source.random(1500) < 0.5, 3.5, -3.5) - 0.7 * (u @ direction), direction)
    part = fit(u, np.full(1500, 1 / 1500), 12, source)
    along = part.means @ (part.basis.T @ direction)
    assert part.shares.size == 2
    np.testing.assert_allclose(np.sort(along), [-3.5, 3.5], atol=0.3)


@pytest.mark.parametrize("problem", [LINEAR_2, CORRELATED, BETAS], ids=lambda p: p.name)
def test_known_probabilities_are_found(problem):
    estimates = [
        ce.estimate(problem.f, problem.base, problem.gamma, "mixture", budget=10_000, seed=s)
        for s in range(6)
    ]
    z = np.array([(e.p - problem.p) / e.std_error for e in estimates])
    assert np.abs(z).max() < 4
    assert abs(z.mean()) < 4 / math.sqrt(6)
    assert all(e.efficiency > 100 and e.rollouts == 10_000 for e in estimates)
    assert sum(bool(e.warnings) for e in estimates) <= 1


def test_both_of_two_modes_are_found():
    """|x_0| > 4.2 in d = 50: a single product would find one side and half of p."""
    base = ce.Product([ce.Normal(np.zeros(50), np.eye(50))])
    p = math.erfc(4.2 / math.sqrt(2))
    for seed in range(2):
        est = ce.estimate(lambda x: -np.abs(x[:, 0]), base, -4.2, "mixture", budget=20_000, seed=seed)
        assert est.p == pytest.approx(p, abs=4 * est.std_error)
        assert est.efficiency > 300


@pytest.mark.long
def test_four_modes_among_driver_weights():
    est = ce.estimate(traffic.f, traffic.base(), 0.0, "mixture", budget=60_000, seed=0)
    assert est.p == pytest.approx(traffic.P, abs=4 * est.std_error)
    assert est.ess > 300
    assert est.efficiency > 20


def test_resuming_at_every_step_gives_the_same_bits():
    options = ce.MixtureOptions(budget=3000, batch_size=700, rel_error=0.05)
    algorithm = ce.algorithm("mixture", BETAS.base, BETAS.gamma, options)
    steps = resumed_at_every_step(algorithm, BETAS.f, 5)
    keys = [(batch.phase, batch.iteration, batch.start) for batch, _ in steps]
    assert len(set(keys)) == len(keys)


def test_search_ends_where_there_is_nothing_to_find():
    for f in (
        lambda x: np.ones(len(x)),
        lambda x: np.full(len(x), np.inf),
        lambda x: np.full(len(x), np.nan),
    ):
        est = ce.estimate(f, BETAS.base, 0.0, "mixture", budget=1000)
        assert est.p == 0
        assert est.ci[1] > 0
        assert not est.converged
        assert "threshold-not-reached" in [w.name for w in est.warnings]


def test_events_with_an_infinite_rest_are_found():
    """As time to collision: +inf wherever nothing closes in."""
    p = BETAS.p

    def f(x):
        return np.where(x[:, 0] < 0.5, BETAS.f(x), np.inf)

    est = ce.estimate(f, BETAS.base, BETAS.gamma, "mixture", budget=20_000, seed=1)
    assert est.p == pytest.approx(p, abs=4 * est.std_error)
    assert est.efficiency > 100


def test_small_searches_say_so():
    est = ce.estimate(LINEAR_2.f, LINEAR_2.base, 0.0, "mixture", budget=3000)
    assert "small-search" in [w.name for w in est.warnings]


def test_all_four_branches_are_found():
    problem = next(p for p in ALL if p.name == "four-branch k=7")
    for seed in range(4):
        est = ce.estimate(problem.f, problem.base, 0.0, "mixture", budget=10_000, seed=seed)
        assert est.p == pytest.approx(problem.p, abs=4 * est.std_error)
        assert est.std_error < 0.03 * est.p
