"""Paths split and ended along the way: unbiased for any committor, the same bits for any division of the roots."""

import functools
from itertools import pairwise

import numpy as np
import pytest

import ce
from ce.paths import exactly, keys
from tests.reference.path_problems import WALK, birth_death, gaussian

PROBLEM = gaussian("random walk", WALK, 3.0)
LEVELS = np.array([1.0, 0.0])
CANDIDATES = 2000


class Straight:
    """log hazard of what is missing to a level, in units of what a walk still spreads."""

    def __init__(self, wrong: bool = False) -> None:
        self.wrong = wrong

    def log_hazard(self, features, levels):
        missing = 3.0 - features[:, 0, 0].astype(np.float64)
        left = np.sqrt(np.maximum(1.0 - features[:, 0, 1].astype(np.float64), 0.01))
        z = np.maximum(missing[:, None] - levels, 0.0) / left[:, None]
        return (1.0 if self.wrong else -0.5) * z * z - 9.0 * self.wrong


GOOD, BAD = Straight(), Straight(wrong=True)


@functools.cache
def planned(process, committor, population=150.0):
    x, seeds = ce.draw(process.base, 5, "train", 0, 0, 4000)
    hazard = committor.log_hazard(process.features(process.begin(x, seeds)), LEVELS)
    return ce.paths.schedule(0.0, LEVELS, hazard, process.checkpoints, CANDIDATES, population)


def batch(problem, committor, seed, iteration=0):
    plan = planned(problem.process, committor)
    roots = ce.paths.kept_starts(problem.process, committor, plan, seed, "estimate", iteration, CANDIDATES)
    return roots, ce.paths.drive(problem.process, roots, LEVELS, problem.process.checkpoints, plan, committor)


@pytest.mark.parametrize("wrong", [False, True], ids=["good", "bad"])
def test_the_weighted_events_are_unbiased_whatever_the_committor(wrong):
    driven = [batch(PROBLEM, BAD if wrong else GOOD, 7, k)[1] for k in range(60)]
    p = np.array([d.events[:, 1].sum() for d in driven]) / CANDIDATES
    assert abs(p.mean() - PROBLEM.p) < 4.0 * p.std(ddof=1) / np.sqrt(p.size)
    if not wrong:
        paths = np.mean([d.steps.sum() for d in driven]) / 100
        assert p.var(ddof=1) < 0.3 * PROBLEM.p * (1.0 - PROBLEM.p) / paths


def test_a_bad_committor_is_unbiased_on_a_chain_too():
    """The chain's rare event by a committor that holds the top for the least dangerous place."""

    class Downwards:
        def log_hazard(self, features, levels):
            return np.repeat(-6.0 * features[:, 0, :1].astype(np.float64), levels.size, axis=1)

    problem = birth_death(0.75, 8, 60)
    downwards = Downwards()
    p = np.array([batch(problem, downwards, 3, k)[1].events[:, 1].sum() for k in range(60)]) / CANDIDATES
    assert abs(p.mean() - problem.p) < 4.0 * p.std(ddof=1) / np.sqrt(p.size)


def test_any_division_of_the_roots_gives_the_same_bits():
    roots, whole = batch(PROBLEM, GOOD, 11)
    plan = planned(PROBLEM.process, GOOD)
    cuts = [0, 1, 7, roots.size // 2, roots.size]
    parts = [
        ce.paths.drive(
            PROBLEM.process,
            roots.part(a, b),
            LEVELS,
            PROBLEM.process.checkpoints,
            plan,
            GOOD,
        )
        for a, b in pairwise(cuts)
    ]
    again = ce.paths.joined(parts)
    for name in ("events", "hits", "steps", "begun", "root", "weight", "value", "lineage"):
        assert np.array_equal(getattr(again, name), getattr(whole, name)), name


def test_a_path_is_driven_again_by_the_keys_of_its_segments():
    roots, driven = batch(PROBLEM, GOOD, 7)
    at = driven.root
    states = ce.paths.replay(
        PROBLEM.process, roots.x[at], roots.seeds[at], driven.lineage, PROBLEM.process.checkpoints
    )
    assert np.array_equal(PROBLEM.process.measure(states), driven.value)
    assert driven.begun.sum() > roots.size
    assert np.count_nonzero(driven.value <= 0.0) > 0


def test_weights_keep_the_number_of_paths():
    """The weighted number of paths that come to their end is that of the starts drawn, on average."""
    total = [batch(PROBLEM, GOOD, 17, k)[1].weight.sum() / CANDIDATES for k in range(40)]
    assert abs(np.mean(total) - 1.0) < 4.0 * np.std(total, ddof=1) / np.sqrt(40)


def test_exact_arithmetic_is_exact_enough():
    x = np.concatenate([np.linspace(-700, 700, 4001), [0.0, -0.0, 1e-300]])
    assert np.max(np.abs(exactly.exp(x) / np.exp(x) - 1.0)) < 1e-15
    y = np.geomspace(1e-300, 1e300, 4001)
    assert np.max(np.abs(exactly.log(y) - np.log(y)) / np.maximum(np.abs(np.log(y)), 1.0)) < 1e-15
    a, b = np.random.default_rng(1).standard_normal((2, 300, 300))
    assert np.max(np.abs(exactly.product(a, b) - a @ b)) < 1e-3
    order = np.random.default_rng(2).permutation(300)
    assert np.array_equal(exactly.product(a, b), exactly.product(a[:, order], b[order]))


def test_keys_of_children_and_their_normals_are_independent():
    parents = np.arange(20_000, dtype=np.uint64)
    z = np.concatenate([keys.normals(keys.children(parents, k), 3) for k in (0, 1)], axis=1)
    assert np.max(np.abs(np.corrcoef(z.T) - np.eye(6))) < 4.5 / np.sqrt(20_000)
    assert abs(z.mean()) < 4.0 / np.sqrt(z.size)
    assert abs(z.var() - 1.0) < 4.0 * np.sqrt(2.0 / z.size)
    assert np.unique(keys.children(parents, 0)).size == 20_000


def test_a_pilot_climbs_the_level_of_a_process_and_events_are_of_its_measure():
    """The level falls with the walk; the measure is 5 everywhere but where the walk has come to 1."""

    class Hidden:
        def __init__(self):
            self.walk = PROBLEM.process

        def __getattr__(self, name):
            return getattr(self.walk, name)

        def measure(self, states):
            own = self.walk.measure(states)
            return np.where(own <= 0.0, own, 5.0)

        def level(self, states):
            return self.walk.measure(states)

    hidden = Hidden()
    roots = ce.paths.all_starts(hidden, 1, "estimate", 0, 400)
    checkpoints = hidden.checkpoints
    driven = ce.paths.drive(hidden, roots, np.array([0.0]), checkpoints, record=True)
    plain = ce.paths.drive(PROBLEM.process, roots, np.array([0.0]), checkpoints, record=True)
    assert set(np.unique(driven.value[driven.value > 0.0])) == {5.0}
    np.testing.assert_array_equal(driven.events, plain.events)
    np.testing.assert_array_equal(driven.fallen.after, plain.fallen.after)
    above = ce.paths.drive(hidden, roots, np.array([6.0]), checkpoints)
    assert (above.fallen.after <= 5.0).all()
