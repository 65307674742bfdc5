import numpy as np
import pytest
from scipy.optimize import minimize
from scipy.special import betaln, digamma

import ce
from ce import beta_update
from ce.mean_update import BoxedMean
from ce.projection import Projection


def lbfgsb(target, low, high):
    def objective(t):
        both = digamma(t.sum())
        return betaln(*t) - t @ target, digamma(t) - both - target

    starts = [[a, b] for a in (low[0], high[0], (low[0] * high[0]) ** 0.5) for b in (low[1], high[1], 3.0)]
    bounds = list(zip(low, high, strict=True))
    found = [
        minimize(
            objective,
            np.clip(s, low, high),
            jac=True,
            method="L-BFGS-B",
            bounds=bounds,
            options={"ftol": 1e-15, "gtol": 1e-12},
        )
        for s in starts
    ]
    return min(found, key=lambda r: r.fun)


@pytest.mark.parametrize("bounds", [(1.5, 7.0), (0.2, 50.0), (2.0, 2.0)])
def test_beta_update_agrees_with_lbfgsb_from_many_starts(bounds):
    rng = np.random.default_rng(0)
    m = 60
    true = np.exp(rng.uniform(np.log(0.3), np.log(80), size=(2, m)))
    target = digamma(true) - digamma(true.sum(axis=0))
    target[:, :10] -= rng.exponential(0.5, size=(2, 10))  # and means that no Beta comes near
    low, high = np.full((2, m), bounds[0]), np.full((2, m), bounds[1])
    theta = beta_update.update(np.full((2, m), 2.0), target, low, high)
    assert np.all((theta >= low) & (theta <= high))
    for i in range(m):
        best = lbfgsb(target[:, i], low[:, i], high[:, i])
        mine = betaln(*theta[:, i]) - theta[:, i] @ target[:, i]
        assert mine <= best.fun + 1e-10 * abs(best.fun)
        np.testing.assert_allclose(theta[:, i], best.x, rtol=2e-4, atol=1e-5)


def test_beta_update_does_not_depend_on_its_start():
    rng = np.random.default_rng(1)
    true = rng.uniform(1, 9, size=(2, 40))
    target = digamma(true) - digamma(true.sum(axis=0))
    low, high = np.full((2, 40), 1.5), np.full((2, 40), 7.0)
    ends = [beta_update.update(rng.uniform(1.5, 7, size=(2, 40)), target, low, high) for _ in range(3)]
    np.testing.assert_allclose(ends[0], ends[1], rtol=1e-8)
    np.testing.assert_allclose(ends[0], ends[2], rtol=1e-8)


def random_normal(d, seed):
    rng = np.random.default_rng(seed)
    g = rng.normal(size=(d, 3))
    return ce.Normal(rng.normal(size=d), 0.03**2 * (np.diag(rng.uniform(0.3, 1, d)) + 2 * g @ g.T / 3))


@pytest.mark.parametrize("d", [3, 20])
@pytest.mark.parametrize("seed", range(4))
def test_boxed_mean_is_the_brute_force_optimum(d, seed):
    base = random_normal(d, seed)
    box = 0.01
    precision = np.linalg.inv(base.cov)
    target = base.mean + np.random.default_rng(seed + 100).normal(size=d) * 0.02
    found = BoxedMean(base, box).update(target)
    assert np.all(np.abs(found - base.mean) <= box)
    scale = np.trace(precision) / d

    def objective(mean):
        r = mean - target
        return 0.5 * r @ precision @ r / scale

    # Coordinate descent converges to the optimum of a box-constrained strictly convex quadratic.
    mean = base.mean.copy()
    for _ in range(20_000):
        before = mean.copy()
        for j in range(d):
            pull = precision[j] @ (mean - target) / precision[j, j]
            mean[j] = np.clip(mean[j] - pull, base.mean[j] - box, base.mean[j] + box)
        if np.abs(mean - before).max() < 1e-15:
            break
    assert objective(found) <= objective(mean) + 1e-9 * abs(objective(mean))
    np.testing.assert_allclose(found, mean, atol=1e-9)


def test_boxed_mean_in_404_dimensions_is_feasible_optimal_and_repeatable():
    base = random_normal(404, 7)
    box = 0.01
    target = base.mean + np.random.default_rng(8).normal(size=404) * 0.02
    boxed = BoxedMean(base, box)
    found = boxed.update(target)
    np.testing.assert_array_equal(found, BoxedMean(base, box).update(target))
    boxed.update(target + 0.01)  # an unrelated call leaves no trace
    np.testing.assert_array_equal(found, boxed.update(target))
    assert np.all(np.abs(found - base.mean) <= box)
    gradient = np.linalg.solve(base.cov, found - target)
    scale = np.abs(gradient).max()
    above, below = found - base.mean > box * (1 - 1e-9), found - base.mean < -box * (1 - 1e-9)
    assert 0 < np.count_nonzero(above | below) < 404
    assert np.all(gradient[above] <= 1e-9 * scale)
    assert np.all(gradient[below] >= -1e-9 * scale)
    assert np.abs(gradient[~(above | below)]).max() <= 1e-9 * scale


def test_target_inside_the_box_is_kept():
    base = random_normal(5, 1)
    target = base.mean + 0.005
    np.testing.assert_allclose(BoxedMean(base, 0.01).update(target), target, rtol=1e-14)


def test_update_does_not_depend_on_the_order_of_the_samples_and_a_zero_step_stays():
    base = ce.Product([ce.Beta(2, 2), random_normal(3, 2), ce.Beta(2, 3, -1, 1)])
    x, _ = ce.draw(base, 0, "train", 0, 0, 200)
    w = np.random.default_rng(0).dirichlet(np.ones(200))
    projection = Projection(base, (1.5, 7.0), 0.01)
    order = np.random.default_rng(1).permutation(200)
    np.testing.assert_allclose(
        projection.update(base, x, w, 0.8), projection.update(base, x[order], w[order], 0.8), rtol=1e-9
    )
    np.testing.assert_allclose(projection.update(base, x, w, 1e-15), base.parameters(), rtol=1e-9)


def test_base_outside_the_beta_bounds_widens_them():
    base = ce.Product([ce.Beta(1.0, 9.0)])
    x, _ = ce.draw(base, 0, "train", 0, 0, 5000)
    theta = Projection(base, (1.5, 7.0), 0.01).update(base, x, np.full(5000, 1 / 5000), 0.8)
    np.testing.assert_allclose(theta, [1.0, 9.0], rtol=0.1)
    assert theta[0] >= 1.0
    assert theta[1] <= 9.0


def test_covariance_update_matches_the_moments_of_the_mixture():
    base = ce.Product([ce.Normal([0.0, 1.0], [[1.0, 0.3], [0.3, 2.0]])])
    x = np.random.default_rng(0).normal(size=(500, 2)) * 0.5 + 2
    theta = Projection(base, (1.5, 7.0), None, True).update(base, x, np.full(500, 1 / 500), 0.8)
    block = base.normals[0][1]
    mean = 0.8 * x.mean(axis=0) + 0.2 * block.mean
    second = 0.8 * x.T @ x / 500 + 0.2 * (block.cov + np.outer(block.mean, block.mean))
    np.testing.assert_allclose(theta[:2], mean)
    np.testing.assert_allclose(theta[2:].reshape(2, 2), second - np.outer(mean, mean))
