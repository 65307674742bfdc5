"""A committor for keeps: taught once, it serves estimates that pay for no training."""

import numpy as np
import pytest

import ce
from tests.reference.path_problems import WALK, gaussian

PROBLEM = gaussian("random walk", WALK, 3.0)
HOW = ce.paths.Teaching((1.0, 0.0), naive=300, rounds=3, population=100.0, starts_a_path=10, steps=600)


@pytest.fixture(scope="module")
def taught():
    rounds = []
    found = ce.paths.teach([PROBLEM.process, PROBLEM.process], HOW, 1, lambda *told: rounds.append(told))
    return found, rounds


def test_rounds_of_every_process_come_down_towards_the_levels_asked_for(taught):
    found, rounds = taught
    assert [told[:2] for told in rounds] == [(n, k) for n in (0, 1) for k in range(4)]
    aims = [told[2] for told in rounds]
    assert aims[0] == np.inf
    assert min(aims) < 1.0
    assert found.paths > 2 * HOW.naive


def test_an_estimate_that_starts_from_it_holds_and_trains_nothing(taught):
    options = ce.PathOptions(budget=2000, batches=10)
    est = ce.paths.estimate_paths(
        PROBLEM.process, 0.0, options=options, committor=taught[0].committor, seed=3
    )
    assert est.ci[0] < PROBLEM.p < est.ci[1]
    assert est.cost.training_steps < 0.2 * est.cost.steps


def test_what_no_path_comes_to_cannot_be_taught():
    still = ce.Simulator(
        base=PROBLEM.process.base, start=lambda x: x, step=lambda s, z, k: s, measure=lambda s: np.full(len(s), np.inf),
        horizon=10,
    )  # fmt: skip
    with pytest.raises(ValueError, match="give more naive paths"):
        ce.paths.teach([still], ce.paths.Teaching((0.0,), naive=25, rounds=1), 1)
