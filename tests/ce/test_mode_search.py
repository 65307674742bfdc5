"""Parts of an event that the search is led away from are found, and where nothing is to be found it ends."""

import math

import numpy as np
import pytest

import ce
from ce import mode_search
from ce.gaussian_mixture import Part
from ce.mixture_fit import aligned
from tests.reference.variants import VARIANTS

KNOWN = {problem.name: problem for problem in VARIANTS}


@pytest.mark.parametrize("name", ["misleading", "series 4 unequal d=20", "series 8 modes mixed"])
def test_every_mode_is_found(name):
    problem = KNOWN[name]
    for seed in range(2):
        est = ce.estimate(problem.f, problem.base, problem.gamma, "mixture", budget=20_000, seed=seed)
        low, high = est.ci
        assert 0.8 * low <= problem.p <= 1.25 * high
        assert est.p == pytest.approx(problem.p, rel=0.3)
        assert est.mode_coverage > 0.5


def test_without_the_mode_search_the_greater_mode_is_missed():
    problem = KNOWN["misleading"]
    options = ce.MixtureOptions(budget=20_000, mode_search_share=0)
    ratios = [
        ce.estimate(problem.f, problem.base, 0.0, "mixture", options=options, seed=s).p / problem.p
        for s in range(4)
    ]
    assert min(ratios) < 0.1


def test_chains_stay_within_the_event_and_cool_down():
    state, chains = mode_search.init(30, 0.0), 40

    def f(u):
        return 3.0 - np.abs(u[:, 0])

    iteration = 0
    while not state.over:
        u, noise = mode_search.propose(state, 600, 7, iteration)
        state = mode_search.update(state, u, noise, f(u), 0.0, chains, 7, iteration)
        iteration += 1
    assert iteration == mode_search.MOVES + 1
    assert np.all(f(state.chains.u) <= 0.0)
    assert {-1.0, 1.0} == set(np.sign(state.chains.u[:, 0]))
    begun_at = np.sum(mode_search.propose(mode_search.init(30, 0.0), 600, 7, 0)[0][:, 1:] ** 2, axis=1)
    norms = np.sum(state.chains.u[:, 1:] ** 2, axis=1)
    assert 20.0 < norms.mean() < 0.6 * begun_at.mean()  # of 29 in the base
    assert state.visited.shape == (mode_search.KEPT_MOVES * chains, 30)


@pytest.mark.parametrize("value", [1.0, math.inf, math.nan])
def test_it_ends_where_there_are_no_events(value):
    state = mode_search.init(5, math.inf)
    u, noise = mode_search.propose(state, 100, 0, 0)
    state = mode_search.update(state, u, noise, np.full(100, value), 0.0, 20, 0, 0)
    assert state.over


def test_states_that_no_proposal_reaches_are_told_apart():
    usual = np.log(np.full(100, 1e-4))
    states = np.log([1e-4, 1.5e-3, 1e-2, 8.0])
    np.testing.assert_array_equal(mode_search.uncovered(states, usual), [False, False, True, True])


def test_a_mean_over_few_chains_is_brought_back_to_the_line_on_which_f_falls():
    d, source = 20, np.random.default_rng(5)
    directions = np.linalg.qr(source.standard_normal((d, 2)))[0].T
    means = 4.0 * directions + 0.7 * source.standard_normal((2, d))  # off by three deviations
    basis = np.linalg.qr(means.T)[0]
    part = Part(0.4, basis, np.array([0.5, 0.5]), means @ basis, np.stack([np.eye(2)] * 2), 1.0)
    label = np.repeat([0, 1, -1], [80, 80, 40])
    u = source.standard_normal((200, d)) + np.vstack([means, np.zeros(d)])[label]
    f = np.min(4.0 - u @ directions.T, axis=1)
    better = aligned(part, label, u, f)
    assert better.weight == part.weight
    assert better.means @ better.basis.T == pytest.approx(
        np.sum(means * directions, axis=1)[:, None] * directions, abs=0.05
    )


def test_a_mean_stays_where_f_tells_no_line():
    d, source = 20, np.random.default_rng(6)
    mean = 4.0 * np.eye(d)[:1]
    part = Part(0.4, mean.T / 4.0, np.ones(1), np.array([[4.0]]), np.ones((1, 1, 1)), 1.0)
    u = source.standard_normal((100, d)) + mean
    label = np.zeros(100, dtype=np.intp)
    for f in (source.random(100), np.full(100, np.inf), np.full(100, np.nan)):
        assert aligned(part, label, u, f) is part
