import math

import numpy as np
import pytest

import ce
from tests.ce.resuming import resumed_at_every_step
from tests.reference.problems import LINEAR_2


def test_interval_covers_about_as_often_as_it_says():
    problem = LINEAR_2
    gamma = 2.0  # f = 3.5 - z <= 2: p = Phi(-1.5)
    p = 0.5 * math.erfc(1.5 / math.sqrt(2))
    covered, z = 0, []
    for seed in range(200):
        est = ce.estimate(problem.f, problem.base, gamma, "naive", budget=1000, seed=seed)
        covered += est.ci[0] <= p <= est.ci[1]
        z.append((est.p - p) / math.sqrt(p * (1 - p) / 1000))
    assert covered >= 183  # exact intervals: at least 190 expected; P(fewer than 183) < 0.1%
    assert abs(np.mean(z)) < 4 / math.sqrt(200)


def test_no_events_give_an_upper_bound():
    est = ce.estimate(lambda x: np.ones(len(x)), LINEAR_2.base, 0.0, "naive", budget=1000)
    assert est.p == est.std_error == est.ci[0] == 0
    assert est.ci[1] == pytest.approx(1 - 0.025 ** (1 / 1000))
    assert [w.name for w in est.warnings] == ["no-events"]
    assert not est.converged


def test_batches_resume_to_the_same_bits():
    options = ce.NaiveOptions(budget=2300, batch_size=1000)
    algorithm = ce.algorithm("naive", LINEAR_2.base, 1.0, options)
    sizes = [len(batch.x) for batch, _ in resumed_at_every_step(algorithm, LINEAR_2.f, 5)]
    assert sizes == [1000, 1000, 300]


def test_failures_are_no_events_in_p_and_events_in_the_upper_end():
    def f(x):
        return np.where(np.arange(len(x)) < 20, np.nan, 1.0)

    algorithm = ce.algorithm("naive", LINEAR_2.base, 0.0, ce.NaiveOptions(budget=1000))
    state = algorithm.init(0)
    state, record = algorithm.update(state, b := algorithm.propose(state), f(b.x))
    est = algorithm.estimate(state)
    assert est.p == 0
    assert est.ci[1] == pytest.approx(0.0307, abs=1e-3)  # Clopper-Pearson for 20 of 1000
    assert est.failed == record.failed == 20
    assert est.failed_rollouts[19] == ce.FailedRollout("estimate", 0, 19)


def test_target_precision_stops_at_a_planned_interim_look():
    options = ce.NaiveOptions(budget=400_000, rel_error=0.1, batch_size=1000)
    algorithm = ce.algorithm("naive", LINEAR_2.base, 2.0, options)
    state, interims = algorithm.init(0), set()
    while (batch := algorithm.propose(state)) is not None:
        interims.add(state.interim_at)
        state, _ = algorithm.update(state, batch, LINEAR_2.f(batch.x))
    est = algorithm.estimate(state)
    assert est.converged
    assert est.rollouts < 20_000
    assert len(interims) <= 4


def test_efficiency_is_one():
    est = ce.estimate(LINEAR_2.f, LINEAR_2.base, 2.0, "naive", budget=1000)
    assert est.efficiency == pytest.approx(1.0)


@pytest.mark.parametrize("budget", [0, -5])
def test_budget_too_small_is_refused(budget):
    with pytest.raises(ce.BudgetError):
        ce.estimate(LINEAR_2.f, LINEAR_2.base, 0.0, "naive", budget=budget)
