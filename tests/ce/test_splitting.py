import math

import numpy as np
import pytest

import ce
from tests.ce.resuming import resumed_at_every_step
from tests.reference.problems import BETAS, LINEAR_2, LINEAR_404


@pytest.mark.parametrize("problem", [LINEAR_2, BETAS], ids=lambda p: p.name)
def test_known_probabilities_are_found_without_bias(problem):
    estimates = [
        ce.estimate(problem.f, problem.base, problem.gamma, "splitting", budget=20_000, seed=s)
        for s in range(16)
    ]
    p = np.array([e.p for e in estimates])
    assert abs(p.mean() - problem.p) < 4 * p.std(ddof=1) / math.sqrt(p.size)
    assert p.std(ddof=1) < 0.8 * problem.p
    covered = [e.ci[0] <= problem.p <= e.ci[1] for e in estimates]
    assert sum(covered) >= 12  # P(fewer) < 0.1% at 95%
    assert all(0.8 * 20_000 < e.rollouts <= 20_000 for e in estimates)
    assert all(e.training_rollouts < 0.4 * e.rollouts for e in estimates)


def test_high_dimension():
    est = ce.estimate(LINEAR_404.f, LINEAR_404.base, 0.0, "splitting", budget=40_000, seed=0)
    assert est.p == pytest.approx(LINEAR_404.p, abs=4 * est.std_error)
    assert est.std_error < 0.3 * est.p


def test_the_noise_of_a_rollout_is_moved_too():
    """An event that sits in the noise alone: f is a function of the rollout's seed."""
    base = ce.Product([ce.Normal([0.0], [[1.0]])])
    algorithm = ce.algorithm("splitting", base, 0.01, ce.SplittingOptions(budget=20_000))
    state = algorithm.init(0)
    while (batch := algorithm.propose(state)) is not None:
        state, _ = algorithm.update(state, batch, (batch.noise >> np.uint64(11)) * 2.0**-53)
    est = algorithm.estimate(state)
    assert est.p == pytest.approx(0.01, abs=4 * est.std_error)
    assert est.std_error < 0.002


def test_curve_has_all_thresholds_down_to_gamma():
    est = ce.estimate(LINEAR_2.f, LINEAR_2.base, 0.0, "splitting", budget=50_000, seed=3)
    curve = est.curve([0.0, 1.0, 2.5, 3.5])
    exact = [0.5 * math.erfc((3.5 - g) / math.sqrt(2)) for g in curve.gammas]
    assert np.all(np.abs(curve.p - exact) < 4 * curve.std_error)
    assert np.all(np.diff(curve.p) > 0)
    assert curve.p[0] == est.p
    weights = np.exp(est.log_weights)
    assert weights.sum() / (est.replication.max() + 1) == pytest.approx(1.0)


def test_resuming_at_every_step_gives_the_same_bits():
    algorithm = ce.algorithm("splitting", BETAS.base, BETAS.gamma, ce.SplittingOptions(budget=3000))
    keys = []
    for batch, state in resumed_at_every_step(algorithm, BETAS.f, 5):
        assert batch.explicit
        keys.append((batch.phase, batch.iteration, batch.start))
        algorithm.estimate(state)
    assert len(set(keys)) == len(keys)


@pytest.mark.parametrize(
    "f",
    [
        lambda x: np.ones(len(x)),
        lambda x: np.full(len(x), np.inf),
        lambda x: np.full(len(x), np.nan),
        lambda x: np.where(x[:, 0] < 0.5, 1.0, np.inf),
    ],
    ids=["constant", "infinite", "failed", "plateau"],
)
def test_search_ends_where_there_is_nothing_to_find(f):
    est = ce.estimate(f, BETAS.base, 0.0, "splitting", budget=2000)
    assert est.finished
    assert est.p == 0
    assert est.ci[1] > 0
    assert not est.converged
    assert "threshold-not-reached" in [w.name for w in est.warnings]


def test_events_with_an_infinite_rest_are_found():
    est = ce.estimate(
        lambda x: np.where(x[:, 0] < 0.5, BETAS.f(x), np.inf), BETAS.base, 0.3, "splitting", budget=30_000
    )
    assert est.p == pytest.approx((3 * 0.3**2 - 2 * 0.3**3) ** 5, abs=4 * est.std_error)


def test_target_precision_stops_after_a_group():
    est = ce.estimate(LINEAR_2.f, LINEAR_2.base, 2.0, "splitting", budget=60_000, rel_error=0.5, seed=1)
    assert est.converged
    assert est.rollouts < 45_000
