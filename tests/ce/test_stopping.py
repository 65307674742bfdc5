"""Stopping at a target precision: planned from a trial that the estimate leaves out."""

import itertools
import math

import numpy as np
import pytest

import ce
from ce.stopping import SPENDING, first_interim, left_out, next_interim
from tests.reference.problems import LINEAR_2

BASE = LINEAR_2.base


def given(n, w=1.0, share=0.1, rel_error=0.1):
    source = np.random.default_rng(0)
    f = np.where(source.random(n) < share, -1.0, 1.0)
    return ce.Estimate(
        gamma=0.0,
        method="any",
        confidence=0.95,
        rollouts=n,
        training_rollouts=0,
        f=f,
        log_weights=np.full(n, math.log(w)),
        proposal=BASE,
        rel_error=rel_error,
    )


def test_the_interim_looks_share_the_error():
    assert sum(SPENDING) <= 1.0 + 1e-12
    assert all(a >= b for a, b in itertools.pairwise(SPENDING))


def test_without_a_target_there_is_one_interim_look_at_the_end():
    assert first_interim(None, 10_000, 500) == 10_000
    plan = next_interim(given(10_000, rel_error=None), 10_000, 10_000, 0, 0)
    assert plan.done
    assert plan.trial == 0


def test_the_trial_plans_what_follows_and_is_left_out():
    est = given(1000)
    plan = next_interim(est, 1000, 100_000, 0, 0)
    assert not plan.done
    assert plan.trial == 1000
    exact = (1.96 / 0.1) ** 2 * (1 - 0.1) / 0.1
    assert 1.0 * exact < plan.interim_at - 1000 < 2.0 * exact
    assert left_out(1500, plan.interim_at, 1000) == 0  # on the way everything counts
    assert left_out(plan.interim_at, plan.interim_at, 1000) == 1000


def test_a_trial_with_few_events_is_longer():
    plan = next_interim(given(1000, share=0.01), 1000, 100_000, 0, 0)
    assert (plan.interim_at, plan.trial) == (2000, 0)


def test_a_missed_target_has_another_interim_look_and_the_limit_ends_it():
    est = given(1000)  # has about 0.18
    plan = next_interim(est, 1500, 100_000, 500, 0)
    assert not plan.done
    assert plan.interim_looks == 1
    assert plan.trial == 500
    assert next_interim(est, 1500, 1500, 500, 0).done


@pytest.mark.parametrize("method", ["naive", "ce", "mixture"])
def test_intervals_hold_and_the_target_is_met(method):
    gamma = 1.5 if method == "naive" else 0.0
    p = 0.5 * math.erfc((3.5 - gamma) / math.sqrt(2))
    covered, met = 0, 0
    for seed in range(6):
        est = ce.estimate(LINEAR_2.f, BASE, gamma, method, budget=40_000, rel_error=0.15, seed=seed)
        covered += est.ci[0] <= p <= est.ci[1]
        met += est.converged
        assert est.relative_half_width <= 0.15 or not est.converged
        assert est.rollouts < 40_000 or not est.converged
    assert covered >= 4  # P(fewer) < 0.3% at 95%
    assert met >= 5
