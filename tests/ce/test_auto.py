import math

import numpy as np
import pytest

import ce
from ce.records import TrainingRecord
from tests.ce.resuming import resumed_at_every_step
from tests.reference.problems import BETAS, LINEAR_2, linear
from tests.reference.variants import two_sided

HIGH = ce.Product([ce.Normal(np.zeros(60), np.eye(60))])


def scattered(x):
    """An event that no few Gaussians describe: the largest of 60 coordinates."""
    return -np.abs(x).max(axis=1)


def test_common_events_are_left_to_naive_monte_carlo():
    est = ce.estimate(LINEAR_2.f, LINEAR_2.base, 2.5, budget=10_000)
    p = 0.5 * math.erfc(1.0 / math.sqrt(2))
    assert est.method == "naive"
    assert est.rollouts == 10_000
    assert est.training_rollouts == 1000
    assert est.p == pytest.approx(p, abs=4 * est.std_error)


@pytest.mark.parametrize("problem", [LINEAR_2, BETAS], ids=lambda p: p.name)
def test_rare_events_are_searched_for(problem):
    est = ce.estimate(problem.f, problem.base, problem.gamma, budget=10_000)
    assert est.method == "mixture"
    assert est.rollouts == 10_000
    assert est.p == pytest.approx(problem.p, abs=4 * est.std_error)
    assert est.efficiency > 100
    assert not est.warnings


def test_where_no_proposal_fits_it_switches_and_counts_what_that_cost():
    p = 1.0 - (1.0 - math.erfc(5.0 / math.sqrt(2))) ** 60
    est = ce.estimate(scattered, HIGH, -5.0, budget=20_000, seed=2)
    assert est.rollouts <= 20_000
    assert est.ci[0] <= p <= est.ci[1] or est.warnings
    if est.method != "mixture":
        assert est.training_rollouts > 1000


def test_a_search_that_gets_nowhere_is_left_early():
    """Nothing tells the two sides of 404 directions apart but f's square: no proposal gets ahead of the base."""
    problem = two_sided(404, 3.5)
    est = ce.estimate(problem.f, problem.base, problem.gamma, budget=20_000, seed=1)
    assert est.method == "splitting"
    assert est.training_rollouts < 7000
    assert [w.name for w in est.warnings if w.name == "method-switched"]
    assert est.p == pytest.approx(problem.p, abs=4 * est.std_error)


def test_a_search_that_falls_just_short_of_gamma_is_given_a_trial():
    """Its last batch holds no event, but the proposal that was fitted to the level reached does well."""
    problem = linear(404, 5.0, 2.86651572e-7)
    algorithm = ce.algorithm("auto", problem.base, problem.gamma, ce.AutoOptions(budget=20_000))
    state, searched = algorithm.init(5021), []
    while (batch := algorithm.propose(state)) is not None:
        state, record = algorithm.update(state, batch, problem.f(batch.x))
        searched += [record] if isinstance(record, TrainingRecord) else []
    assert searched[-1].events == 0
    est = algorithm.estimate(state)
    assert est.method == "mixture"
    assert est.p == pytest.approx(problem.p, rel=0.2)


@pytest.mark.parametrize("budget", [1, 500, 999])
def test_little_budgets_are_spent_on_naive_monte_carlo(budget):
    est = ce.estimate(LINEAR_2.f, LINEAR_2.base, 0.0, budget=budget)
    assert (est.method, est.rollouts) == ("naive", budget)


@pytest.mark.parametrize(
    ("problem", "gamma", "budget"),
    [(LINEAR_2, 0.0, 2000), (LINEAR_2, 2.5, 2000), (ce.Product([ce.Beta(2, 2)]), None, 2000)],
    ids=["search", "naive", "splitting"],
)
def test_resuming_at_every_step_gives_the_same_bits(problem, gamma, budget):
    base, f = (problem, lambda x: np.ones(len(x))) if gamma is None else (problem.base, problem.f)
    algorithm = ce.algorithm("auto", base, gamma or 0.0, ce.AutoOptions(budget=budget, batch_size=300))
    keys, rollouts = [], 0
    for batch, state in resumed_at_every_step(algorithm, f, 5):
        keys.append((batch.phase, batch.iteration, batch.start))
        rollouts += batch.x.shape[0]
        assert algorithm.estimate(state).rollouts == rollouts
    assert len(set(keys)) == len(keys)
    assert algorithm.estimate(state).finished


def test_failed_rollouts_of_every_stage_are_listed():
    def f(x):
        return np.where(np.arange(len(x)) < 2, np.nan, 1.0)

    est = ce.estimate(f, BETAS.base, 0.0, budget=3000)
    assert est.failed > 4
    assert len({(r.phase, r.iteration, r.index) for r in est.failed_rollouts}) == est.failed
    assert "failed-rollouts" in [w.name for w in est.warnings]
    assert est.ci[1] > 0
