"""The gradient that trains a committor: right, and the same bits in whatever order its sums are taken."""

import numpy as np

from ce.paths import exactly
from ce.paths.network import LEAST, MOST, Net, activation
from ce.paths.training import _gradient, untrained

ROWS, OTHERS, FEATURES = 200, 3, 7


def problem():
    source = np.random.default_rng(4)
    x = exactly.rounded(np.clip(source.standard_normal((ROWS, OTHERS, FEATURES)), -8, 8), 16)
    levels = exactly.rounded(source.uniform(-1, 1, ROWS), 16)
    labels, weights = (source.random(ROWS) < 0.2) * 1.0, source.uniform(0.5, 2.0, ROWS)
    net = untrained(x.astype(np.float32), 0.0, 1.0, 3).nets[0]
    arrays = [a + 0.1 * source.standard_normal(a.shape) for a in net.arrays()]
    return arrays, x, levels, labels, weights


def loss(arrays, x, levels, labels, weights):
    net = Net(*arrays)
    flat = np.concatenate([x.reshape(-1, FEATURES), np.repeat(levels, OTHERS)[:, None]], axis=1)
    hidden = activation(activation(flat @ net.w1 + net.b1) @ net.w2 + net.b2)
    hazard = np.exp(np.clip((hidden @ net.w3 + net.b3)[:, 0], LEAST, MOST)).reshape(ROWS, OTHERS).sum(axis=1)
    return float(np.mean(weights * (hazard - labels * np.log(hazard))))


def test_the_gradient_is_that_of_the_loss():
    arrays, *rest = problem()
    found = _gradient(arrays, *rest)
    source = np.random.default_rng(5)
    for k, array in enumerate(arrays):
        direction, size = source.standard_normal(array.shape), 1e-4
        ends = [
            loss([a + sign * size * direction if j == k else a for j, a in enumerate(arrays)], *rest)
            for sign in (1, -1)
        ]
        slope = (ends[0] - ends[1]) / (2 * size)
        assert abs(np.sum(found[k] * direction) - slope) < 1e-4 * np.linalg.norm(direction)


def test_the_order_of_the_rows_does_not_change_a_bit():
    arrays, x, levels, labels, weights = problem()
    order = np.random.default_rng(6).permutation(ROWS)
    again = _gradient(arrays, x[order], levels[order], labels[order], weights[order])
    for one, other in zip(_gradient(arrays, x, levels, labels, weights), again, strict=True):
        np.testing.assert_array_equal(one, other)
