"""Ratios and their intervals, against values worked out or drawn."""

from __future__ import annotations

import math

import numpy as np
import pytest

import ce
from service.studies.reproduce.ratios import (
    efficiency_of_repeats,
    efficiency_of_spread,
    ratio_of_rare_events,
    ratio_of_variances,
)
from service.studies.reproduce.results import variance_error


def test_the_ratio_of_rare_events_is_that_of_the_rates_and_its_interval_covers():
    assert ratio_of_rare_events(30, 1000, 10, 1000).value == pytest.approx(3.0)
    assert ratio_of_rare_events(30, 500, 10, 1000).value == pytest.approx(6.0)
    none = ratio_of_rare_events(5, 1000, 0, 1000)
    assert math.isnan(none.value)
    assert 0.5 < none.low < none.high == math.inf
    draws = np.random.default_rng(1)
    found = [
        ratio_of_rare_events(int(draws.poisson(40)), 1000, int(draws.poisson(20)), 2000) for _ in range(400)
    ]
    assert np.mean([r.low <= 4.0 <= r.high for r in found]) >= 0.94


def test_the_ratio_of_variances_covers_what_the_estimator_is_worth():
    """Importance sampling of an event with p = 0.01 that the proposal meets with 0.03, weights uneven on purpose."""
    n, met = 4000, 0.03
    draws = np.random.default_rng(2)
    weights = np.array([0.2, 0.3, 0.5])  # of equally likely events: mean 1/3, so that p = met / 3
    true_p = met * weights.mean()
    variance = met * np.mean(weights**2) - true_p**2
    true = true_p * (1 - true_p) / variance
    found = []
    for _ in range(300):
        terms = np.where(draws.random(n) < met, draws.choice(weights, n), 0.0)
        error = terms.std(ddof=1) / math.sqrt(n)
        squares = terms**2
        found.append(
            ratio_of_variances(true_p, 0.0, error, math.sqrt(np.sum(squares**2)) / np.sum(squares), n)
        )
    assert np.mean([r.low <= true <= r.high for r in found]) >= 0.92
    assert np.median([r.value for r in found]) == pytest.approx(true, rel=0.05)
    assert math.isnan(ratio_of_variances(true_p, 0.0, 0.0, None, n).value)


def test_repeats_tell_what_a_method_is_worth_bias_and_all():
    draws = np.random.default_rng(3)
    p, rollouts = 1e-4, 10_000
    honest = p + draws.normal(size=400) * math.sqrt(p / rollouts / 8.0)
    assert efficiency_of_repeats(p, 0.0, honest, rollouts).value == pytest.approx(8.0, rel=0.2)
    assert efficiency_of_repeats(p, 0.0, 0.1 * honest, rollouts).value < 2.0
    assert math.isnan(efficiency_of_repeats(p, 0.0, honest[:1], rollouts).value)
    assert math.isnan(efficiency_of_repeats(p, 0.0, np.zeros(20), rollouts).value)
    few = [efficiency_of_repeats(p, 0.0, part, rollouts) for part in honest.reshape(80, 5)]
    assert np.mean([r.low <= 8.0 <= r.high for r in few]) >= 0.9


def test_many_wide_runs_together_are_worth_what_their_mean_is():
    draws = np.random.default_rng(4)
    p, rollouts = 1e-6, 20_000
    runs = p * draws.gamma(0.5, 2.0, size=(200, 20))  # unbiased, each off by 140%
    exact = p / rollouts / (2.0 * p**2)
    found = [efficiency_of_spread(part, rollouts) for part in runs]
    assert np.median([r.value for r in found]) == pytest.approx(exact, rel=0.3)
    assert np.mean([r.low <= exact <= r.high for r in found]) >= 0.9
    assert math.isnan(efficiency_of_spread(runs[0, :1], rollouts).value)
    assert math.isnan(efficiency_of_spread(np.array([0.0, 0.0, 0.0]), rollouts).value)
    assert math.isnan(efficiency_of_spread(np.array([0.0, 0.0, 1e-6]), rollouts).value)  # of one run


def test_an_estimate_s_own_variance_has_an_error_of_its_own():
    base = ce.Product([ce.Normal(np.zeros(2), np.eye(2))])

    def f(x):
        return x.sum(axis=1)

    naive = ce.estimate(f, base, -1.0, "naive", budget=4000, seed=1)
    assert variance_error(naive, -1.0) == pytest.approx(1.0 / math.sqrt(naive.events))
    assert math.isnan(variance_error(naive, -100.0))
    split = ce.estimate(f, base, -4.0, "splitting", budget=4000, seed=1)
    assert variance_error(split, -4.0) == pytest.approx(math.sqrt(2.0 / 9.0))
