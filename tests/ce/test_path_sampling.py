"""The method for paths as a whole: trained by its pilot, resumable, divisible, and honest about what it did not see."""

from dataclasses import replace
from itertools import pairwise

import msgspec
import numpy as np
import pytest

import ce
from ce.paths.levels import ladder, reached
from ce.paths.tree import Fallen, joined_falls
from tests.reference.path_problems import WALK, decided_at_once, gaussian, normal_base

PROBLEM = gaussian("random walk", WALK, 3.0)
SMALL = ce.PathOptions(budget=1000, batches=5, rounds=3)


def run(method, seed=1, parts=1, resume=False, divide=None):
    state = method.init(seed)
    while (batch := method.propose(state)) is not None:
        cuts = np.linspace(0, batch.roots.size, parts + 1).astype(int)
        driven = [
            ce.paths.drive(
                method.process,
                batch.roots.part(a, b),
                batch.levels,
                method.checkpoints,
                batch.plan,
                method.committor(state),
                batch.record,
            )
            for a, b in pairwise(cuts)
        ]
        if resume:
            state = method.from_bytes(method.to_bytes(state))
        state, _ = method.update(state, batch, ce.paths.joined(driven))
    return state


@pytest.fixture(scope="module")
def finished():
    method = ce.PathSampling(PROBLEM.process, 0.0, SMALL)
    return method, run(method)


def test_the_interval_holds_and_the_cost_is_counted(finished):
    method, state = finished
    est = method.estimate(state)
    low, high = est.ci
    assert est.finished
    assert low < PROBLEM.p < high
    assert low > 0.1 * PROBLEM.p
    assert 0.6 * SMALL.budget < est.cost.steps / 100 < 1.6 * SMALL.budget
    assert est.cost.begun == est.rollouts > est.training_rollouts > 0
    assert est.efficiency > est.efficiency_by_begun > 0.0


def test_a_resumed_run_comes_to_the_same_bits(finished):
    method, state = finished
    again = run(ce.PathSampling(PROBLEM.process, 0.0, SMALL), resume=True)
    assert method.to_bytes(again) == method.to_bytes(state)


def test_a_divided_run_comes_to_the_same_estimate(finished):
    _, state = finished
    later = ce.PathSampling(PROBLEM.process, 0.0, SMALL, state.committor)
    one, many = run(later), run(later, parts=5)
    assert later.to_bytes(one) == later.to_bytes(many)


def test_training_is_the_same_for_any_division(finished):
    method, state = finished
    assert method.to_bytes(run(method, parts=4)) == method.to_bytes(state)


def test_a_committor_is_used_again_without_training(finished):
    _, state = finished
    given = ce.paths.loaded(ce.paths.saved(state.committor))
    est = ce.estimate_paths(PROBLEM.process, 0.0, seed=2, options=SMALL, committor=given)
    assert est.ci[0] < PROBLEM.p < est.ci[1]
    trained = ce.PathSampling(PROBLEM.process, 0.0, SMALL).estimate(state)
    assert est.cost.training_steps < 0.7 * trained.cost.training_steps


def test_damaged_or_other_bytes_are_no_committor(finished):
    data = bytearray(ce.paths.saved(finished[1].committor))
    for broken in (b"junk", bytes(data[:-5])):
        with pytest.raises(ce.StateError, match="not a saved committor"):
            ce.paths.loaded(broken)
    number = finished[1].committor.center[:1].astype("<f8").tobytes()
    data[data.find(number)] ^= 1
    with pytest.raises(ce.StateError, match="damaged"):
        ce.paths.loaded(bytes(data))
    with pytest.raises(ce.ResponseError, match="trained on 2 features"):
        finished[1].committor.log_hazard(np.zeros((3, 1, 5), dtype=np.float32), np.array([0.0]))


def test_a_row_of_the_committor_depends_on_nothing_else(finished):
    committor, source = finished[1].committor, np.random.default_rng(1)
    x = source.normal(size=(500, 1, 2)).astype(np.float32)
    levels = np.array([1.0, 0.0])
    whole = committor.log_hazard(x, levels)
    assert np.array_equal(whole[37:38], committor.log_hazard(x[37:38], levels))
    assert np.array_equal(whole[:, 1:], committor.log_hazard(x, levels[1:]))


def test_what_is_hopeless_ends_with_a_bound_and_says_so():
    """No path comes near: the interval reaches from 0 to what the paths spent can carry."""
    process = ce.Simulator(
        base=normal_base(1),
        start=lambda x: x,
        step=lambda s, z, k: s,
        measure=lambda s: np.full(len(s), np.inf),
        horizon=5,
    )
    est = ce.estimate_paths(process, 0.0, options=SMALL)
    assert est.finished
    assert est.p != est.p or est.p == 0.0
    assert est.ci[0] == 0.0
    assert est.ci[1] > 3.0 / SMALL.budget
    assert "threshold-not-reached" in {w.name for w in est.warnings}


def test_failed_paths_are_named_and_count_for_the_upper_end():
    def measure(s):
        return np.where(np.abs(s[:, 0] - 2.0) < 0.05, np.nan, 3.0 - s[:, 0])

    process = ce.Simulator(
        base=normal_base(1),
        start=lambda x: 0.3 * x,
        step=lambda s, z, k: s + 0.1 * z,
        measure=measure,
        horizon=100,
    )
    est = ce.estimate_paths(process, 0.0, options=SMALL)
    assert est.failed > 0
    assert np.isnan(est.f).any()
    clean = replace(est, f=np.where(np.isnan(est.f), 9.0, est.f))
    assert est.ci[1] > clean.ci[1]


def test_wrong_use_is_refused():
    with pytest.raises(ce.ThresholdError):
        ce.estimate_paths(PROBLEM.process, np.nan)
    with pytest.raises(ce.BudgetError, match="at least"):
        ce.estimate_paths(PROBLEM.process, 0.0, budget=10)
    with pytest.raises(ce.OptionsError, match="checkpoints"):
        ce.Simulator(
            normal_base(1), lambda x: x, lambda s, z, k: s, lambda s: s[:, 0], 10, checkpoints=[1, 10]
        )
    with pytest.raises(ce.StateError, match="train_on"):
        ce.PathSampling(PROBLEM.process, 0.0, ce.PathOptions(train_on=True)).init(0)
    wrong = ce.Simulator(normal_base(1), lambda x: x, lambda s, z, k: s, lambda s: s, 10)
    with pytest.raises(ce.ResponseError, match="measure must give"):
        ce.estimate_paths(wrong, 0.0, options=SMALL)


def test_states_and_batches_of_another_problem_are_refused(finished):
    method, state = finished
    other = ce.PathSampling(PROBLEM.process, 0.5, SMALL)
    with pytest.raises(ce.StateError, match="another"):
        other.from_bytes(method.to_bytes(state))
    begun = method.init(1)
    batch = method.propose(begun)
    driven = ce.paths.drive(method.process, batch.roots, batch.levels, method.checkpoints)
    with pytest.raises(ce.StateError, match="does not answer"):
        method.update(state, batch, driven)
    with pytest.raises(ce.ResponseError, match="roots were to be driven"):
        method.update(begun, msgspec.structs.replace(batch, roots=batch.roots.part(0, 3)), driven)


def test_warnings_name_what_was_seen(finished):
    method, state = finished
    est = method.estimate(state)
    hit = np.flatnonzero(est.f <= 0.0)
    heavy = est.log_weights.copy()
    heavy[hit[0]] = np.log(np.exp(heavy[hit]).sum())
    names = {w.name for w in replace(est, log_weights=heavy).warnings}
    assert "dominant-root" in names
    every = np.ones(est.f.size, dtype=bool)
    assert "floor-roots" in {w.name for w in replace(est, floored=every).warnings}
    apart = (est.p + 10 * est.std_error, est.std_error)
    assert "pilot-disagrees" in {w.name for w in replace(est, pilot_p=apart).warnings}
    assert all(w.remedy for w in replace(est, log_weights=heavy, floored=every, pilot_p=apart).warnings)


def test_one_large_root_widens_the_interval_upwards(finished):
    method, state = finished
    est = method.estimate(state)
    narrow = float(est.p * np.exp(2.57 * est.std_error / est.p))
    assert est.ci[1] > narrow


def test_levels_follow_what_was_reached_below_zero_too():
    def falls(value, root):
        return Fallen.among(root, np.ones(value.size), np.full(value.size, np.inf), value)

    value = -np.arange(1000, dtype=np.float64)
    root = np.arange(1000)
    assert reached(falls(value, root)) == -985.0
    assert reached(falls(value, np.zeros(1000, dtype=np.int64))) == np.inf
    assert reached(falls(np.full(10, np.nan), np.arange(10))) == np.inf
    levels = ladder(falls(value, root), 1000, -985.0, -2000.0)
    assert levels[-1] < -985.0
    assert list(levels) == sorted(levels, reverse=True)
    assert ladder(falls(value, root), 1000, -985.0, -985.0)[-1] == -985.0


def test_a_level_counts_for_paths_that_were_ended_after_they_had_come_to_it():
    """Thirty paths fall to 5, then ten of them to 1; the rest ends by roulette and is in no end."""
    first = Fallen(np.arange(30), np.ones(30), np.full(30, np.inf), np.full(30, 5.0))
    then = Fallen(np.arange(10), np.full(10, 2.0), np.full(10, 5.0), np.full(10, 1.0))
    fallen = joined_falls([first, then])
    assert reached(fallen) == 5.0
    assert reached(fallen, 10) == 1.0
    assert ladder(fallen, 100, 1.0, 0.0)[-1] == 1.0


def test_what_is_decided_at_the_start_costs_no_splitting():
    problem = decided_at_once(3.0)
    est = ce.estimate_paths(problem.process, 0.0, seed=3, options=SMALL)
    assert est.ci[0] < problem.p < est.ci[1]
    assert est.efficiency > 2.0


def test_a_common_event_is_counted():
    common = gaussian("random walk", WALK, 0.8)
    method = ce.PathSampling(common.process, 0.0, replace(SMALL, budget=2000))
    state = run(method)
    est = method.estimate(state)
    assert common.p > 0.3
    assert state.committor is None
    assert 1800 < est.cost.begun <= 2000
    assert np.allclose(est.log_weights, -np.log(est.starts))
    assert abs(est.p - common.p) < 4.0 * np.sqrt(common.p * (1.0 - common.p) / 1700)
    assert est.ci[0] < common.p < est.ci[1]
