"""Paths of the highway: segments driven one after another are the rollout driven as a whole, to the bit."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import kstest

import ce
from service.evaluation.job import Problem, make_job
from service.world.paths.process import HighwayPaths
from service.world.safety.contact_numbers import contact_from
from service.world.scenario import load_scenario
from service.world.scenario.noise import noise_of
from service.world.sim.rollout import OUTCOMES
from service.world.sim.streams import words
from service.world.sim.without_sumo import WithoutSumo
from service.world.sim.world import action_noise

WORLDS = [
    ("i80-paper-10s", "lidar-paper"),
    ("us101-paper-10s", "idm"),
    ("i80-10s", "lidar"),
    ("us101-10s", "idm"),
]


def opened(scenario: str, ego: str) -> tuple[Problem, HighwayPaths]:
    problem = Problem(make_job(load_scenario(scenario), ego, 0.5, "naive", 3, {}))
    return problem, HighwayPaths(problem.job.scenario, problem.corridor, problem.drivers, ego)


def dangerous(problem: Problem, n: int) -> np.ndarray:
    """Draws of P0 of which some end early: a fast ego among slow vehicles, long glances at once."""
    x, _ = ce.draw(problem.base, 3, "estimate", 0, 0, n)
    names = list(problem.base.names or ())
    x[: n // 4, [4 * v + 3 for v in range(6)]] = [20.0, 10.0, 10.0, 10.0, 20.0, 10.0]
    x[: n // 4, 10] = np.linspace(-20.0, 20.0, n // 4)  # a neighbour that starts across its lane
    for column, name in enumerate(names):
        if name.endswith("glance_onset_s"):
            x[::3, column] = np.linspace(0.0, 4.0, n)[::3]
    return x


def test_the_compiled_words_are_numpys():
    out = np.empty(11, np.uint64)
    for key in (0, 1, 2**63 + 12345, 2**64 - 1):
        words(np.uint64(key), out)
        np.testing.assert_array_equal(out, np.random.Philox(key=key).random_raw(11))


def test_one_segment_of_the_papers_drivers_is_the_rollout_with_that_seed():
    problem, process = opened("i80-paper-10s", "lidar-paper")
    x, seeds = dangerous(problem, 20), np.arange(100, 120, dtype=np.uint64)
    states = process.advance(process.begin(x, seeds), seeds, 100)
    alone = WithoutSumo(problem.job.scenario, problem.corridor, problem.drivers, "lidar-paper")
    for i, (draw, seed) in enumerate(zip(x, seeds, strict=True)):
        whole = alone.run(draw, int(seed), action_noise=action_noise(int(seed), 100, 6))
        assert (whole.f, whole.outcome, whole.steps) == (
            states.smallest[i],
            OUTCOMES[states.status[i]],
            states.at[i],
        )


@pytest.mark.parametrize(("scenario", "ego"), WORLDS)
def test_segments_one_after_another_are_the_rollout_driven_with_all_their_noise(scenario, ego):
    problem, process = opened(scenario, ego)
    n = 40
    x, rng = dangerous(problem, n), np.random.default_rng(5)
    keys = rng.integers(0, 2**64, (n, len(process.checkpoints) - 1), dtype=np.uint64)
    states = process.begin(x, keys[:, 0])
    total = np.zeros(n, np.int64)
    for k, until in enumerate(process.checkpoints[1:]):
        before = states
        # through copies of copies, in another order
        order = rng.permutation(n)
        moved = process.advance(process.take(states, order), keys[order, k], until)
        states = process.take(moved, np.argsort(order))
        total += process.steps(states)
        assert before.at.max() <= process.checkpoints[k]  # what is driven on leaves its copy where it was
    np.testing.assert_array_equal(total, states.at)
    alone = WithoutSumo(problem.job.scenario, problem.corridor, problem.drivers, ego)
    outcomes = set()
    with problem.simulator() as simulator:
        for i in range(n):
            draw, noise = process.drawn(x[i], 7, keys[i])
            assert noise_of(str(noise)) == noise
            for world in (alone, simulator):
                whole = world.run(draw, noise)
                assert (whole.f, whole.outcome, whole.steps) == (
                    states.smallest[i],
                    OUTCOMES[states.status[i]],
                    states.at[i],
                )
                assert contact_from(process.finals(states, np.array([i]))[0]) == whole.contact
            outcomes.add(whole.outcome)
    assert {"horizon", "collision"} <= outcomes


def test_a_path_draws_anew_the_glance_that_has_not_begun_and_keeps_the_one_that_has():
    problem, process = opened("i80-10s", "lidar")
    names = list(problem.base.names or ())
    x, _ = ce.draw(problem.base, 1, "estimate", 0, 0, 2)
    onset = names.index("env4.glance_onset_s")
    x[0, onset], x[1, onset] = 0.3, 0.7
    keys = np.array([11, 12], np.uint64)
    (begun, _), (ahead, _) = process.drawn(x[0], 1, keys), process.drawn(x[1], 1, keys)
    assert begun[onset] == x[0, onset]
    assert ahead[onset] != x[1, onset]
    assert ahead[onset] >= 0.5
    assert begun[names.index("env4.glance_duration_s")] == x[0, names.index("env4.glance_duration_s")]
    assert np.isfinite(problem.base.log_density(np.array([begun, ahead]))).all()


def test_causes_and_noise_of_paths_have_the_law_of_p0():
    """Onsets, durations, leaks and modes of paths in twenty segments against the scenario's own draws."""
    problem, process = opened("i80-10s", "lidar")
    names = list(problem.base.names or ())
    n, rng = 400, np.random.default_rng(8)
    x, _ = ce.draw(problem.base, 2, "estimate", 0, 0, n)
    keys = rng.integers(0, 2**64, (n, len(process.checkpoints) - 1), dtype=np.uint64)
    found = np.array([process.drawn(row, 1, own)[0] for row, own in zip(x, keys, strict=True)])
    for kind in (
        "glance_onset_s",
        "glance_duration_s",
        "glance_leak",
        "turn_rate_mode_1",
        "acceleration_mode_2",
    ):
        columns = [i for i, name in enumerate(names) if name.endswith(kind)]
        block = problem.base.blocks[problem.base.starts.index(columns[0])]
        u = np.sort(ce.Product([block]).blocks[0].to_standard(found[:, columns].reshape(-1, 1)).ravel())
        assert kstest(u, "norm").pvalue > 1e-3, kind


def test_features_at_the_start_are_those_of_the_state_and_turn_with_left_and_right():
    problem, process = opened("i80-10s", "lidar")
    x, seeds = ce.draw(problem.base, 4, "estimate", 0, 0, 30)
    states = process.begin(x, seeds)
    first = process.features(states)
    assert first.dtype == np.float32
    assert np.isfinite(first).all()
    np.testing.assert_array_equal(first, process.features(process.begin(x, seeds)))
    later = process.features(process.advance(states, seeds, 5))
    assert (later != first).any()
