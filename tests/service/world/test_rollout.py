"""Rollouts with SUMO in the loop: how they end, what goes wrong in them, and that they give the same bits."""

from __future__ import annotations

import hashlib
import itertools
import json
import math
import os
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import ce
from policies.drivers import DriverModel
from policies.egos import EgoPolicy, Observation
from policies.egos.idm import IdmEgo
from service.analysis import trace
from service.evaluation.job import Problem, make_job
from service.world import agents as A
from service.world.scenario import Scenario
from service.world.scenario.base import base_distribution
from service.world.sim.rollout import Rollout, Simulator
from service.world.sim.world import World, action_noise

BACKGROUND = "\n[background]\ndensity_veh_per_km_lane = 12.0\nspeed_mps = 15.0\n"
TWO_SECONDS = {"horizon_s = 10.0": "horizon_s = 2.0"}


class ScriptedEgo:
    """Answers with what `answer(step)` gives."""

    name = "scripted"

    def __init__(self, answer: Callable[[int], object]):
        self._answer = answer
        self.seeds: list[int] = []

    def reset(self, seed: int) -> None:
        self.seeds.append(seed)
        self._steps = itertools.count()

    def act(self, observation: Observation):
        return self._answer(next(self._steps))


class Recorder:
    """An observer that keeps a copy of every state."""

    def __init__(self) -> None:
        self.time_s: list[float] = []
        self.ttc_s: list[float] = []
        self.agents: list[np.ndarray] = []
        self.actions: list[tuple[float, float] | None] = []

    def see(self, world: World, time_s: float, ttc_s: float, action: tuple[float, float] | None) -> None:
        self.time_s.append(time_s)
        self.ttc_s.append(ttc_s)
        self.agents.append(world.agents[: world.count].copy())
        self.actions.append(action)


@pytest.fixture
def simulate(i80, drivers: DriverModel):
    """simulate(scenario, ego): a simulator that is closed after the test."""
    opened: list[Simulator] = []

    def make(scenario: Scenario, ego: EgoPolicy | None = None) -> Simulator:
        while opened:
            opened.pop().close()
        opened.append(Simulator(scenario, i80, drivers, ego or IdmEgo()))
        return opened[-1]

    yield make
    while opened:
        opened.pop().close()


@pytest.fixture
def draws(drivers: DriverModel):
    """draws(scenario, n): x (n, d) from the base distribution, and n noise seeds."""

    def draw(scenario: Scenario, n: int) -> tuple[np.ndarray, list[int]]:
        x, noise_seeds = ce.draw(base_distribution(scenario, drivers), 3, "estimate", 0, 0, n)
        return x, [int(seed) for seed in noise_seeds]

    return draw


def same(a: Rollout, b: Rollout) -> bool:
    return (np.float64(a.f).tobytes(), a.outcome, a.steps, a.error) == (
        np.float64(b.f).tobytes(),
        b.outcome,
        b.steps,
        b.error,
    )


def test_f_is_the_smallest_time_to_collision_of_all_states(simulate, make_scenario, draws):
    scenario = make_scenario()
    simulator = simulate(scenario)
    x, noise_seeds = draws(scenario, 5)
    for row, seed in zip(x, noise_seeds, strict=True):
        seen = Recorder()
        rollout = simulator.run(row, seed, seen)
        assert rollout.f == min(seen.ttc_s)
        assert len(seen.ttc_s) == rollout.steps + 1
        assert seen.time_s == pytest.approx(0.1 * np.arange(rollout.steps + 1))
        assert seen.actions[-1] is None
        assert None not in seen.actions[:-1]


def test_a_rollout_ends_at_its_horizon(simulate, make_scenario, draws):
    scenario = make_scenario(TWO_SECONDS)
    x, noise_seeds = draws(scenario, 1)
    rollout = simulate(scenario).run(x[0], noise_seeds[0])
    assert (rollout.outcome, rollout.steps) == ("horizon", 20)


def test_a_rollout_ends_at_a_collision_of_the_ego_and_counts_that_state(simulate, make_scenario, draws):
    scenario = make_scenario()
    x, noise_seeds = draws(scenario, 1)
    x = x[0].copy()
    x[:8] = 100.0, 0.0, 0.0, 15.0, 100.5, 0.0, 0.0, 15.0  # the ego in lane 3, env1 in lane 1
    x[8:12] = 101.0, 0.0, 0.0, 15.0  # env2 beside it in lane 2
    seen = Recorder()
    rollout = simulate(scenario, ScriptedEgo(lambda k: (0.0, 0.25))).run(x, noise_seeds[0], seen)
    assert rollout.outcome == "collision"
    assert seen.agents[-1][0, A.COLLISION] == 1.0
    assert seen.agents[-1][2, A.COLLISION] == 1.0
    assert all(state[0, A.COLLISION] == 0.0 for state in seen.agents[:-1])
    assert seen.ttc_s[-1] < min(seen.ttc_s[:-1])
    assert rollout.f == seen.ttc_s[-1] > 0.0


def test_a_collision_at_the_start_is_a_rollout_of_no_steps(simulate, make_scenario, draws):
    scenario = make_scenario()
    x, noise_seeds = draws(scenario, 1)
    x = x[0].copy()
    x[:4] = 100.0, 3.66, 0.0, 15.0  # the ego's offset puts it on env2 in lane 2
    x[8:12] = 101.0, 0.0, 0.0, 12.0
    rollout = simulate(scenario).run(x, noise_seeds[0])
    assert (rollout.outcome, rollout.steps, rollout.f) == ("collision", 0, 0.0)


@pytest.mark.parametrize(
    ("answer", "outcome"), [((1.0, 0.3), "off-road"), ((-8.0, 0.0), "reversing"), ((-9.0, -1.0), "reversing")]
)
def test_the_ego_ends_the_rollout_by_leaving_the_road_or_reversing(
    simulate, make_scenario, draws, answer, outcome
):
    scenario = make_scenario({'name = "ego"\nrole = "ego"\nlane = 3': 'name = "ego"\nrole = "ego"\nlane = 1',
                              'name = "env1"\nlane = 1': 'name = "env1"\nlane = 3'})  # fmt: skip
    x, noise_seeds = draws(scenario, 1)
    x = x[0].copy()
    x[:4] = 119.0, 0.0, 0.0, 11.0
    x[8] = 85.0
    seen = Recorder()
    rollout = simulate(scenario, ScriptedEgo(lambda k: answer)).run(x, noise_seeds[0], seen)
    assert rollout.outcome == outcome
    flag = A.OFF_ROAD if outcome == "off-road" else A.REVERSING
    assert [state[0, flag] for state in seen.agents] == [0.0] * rollout.steps + [1.0]
    assert all(state[0, A.TAKEN_OVER] == 0.0 for state in seen.agents)


def test_the_ego_finishes_at_the_end_of_the_road_and_the_others_leave_the_world(
    simulate, make_scenario, draws
):
    scenario = make_scenario({"low = 80.0, high = 120.0": "low = 1900.0, high = 2000.0"})
    x, noise_seeds = draws(scenario, 4)
    simulator = simulate(scenario)
    left = 0
    for row, seed in zip(x, noise_seeds, strict=True):
        seen = Recorder()
        rollout = simulator.run(row, seed, seen)
        assert rollout.outcome in ("finished", "horizon", "collision")
        assert rollout.error is None
        for before, after in itertools.pairwise(seen.agents):
            gone = before[:, A.ACTIVE] == 0.0
            left += int((after[:, A.ACTIVE] == 0.0).sum() - gone.sum())
            assert (after[gone, A.ACTIVE] == 0.0).all()
    assert left > 0
    assert simulator.run(x[0], noise_seeds[0]).outcome == "finished"


def _fail(k: int):
    raise RuntimeError(f"sensor lost at step {k}")


def _interrupt() -> tuple[float, float]:
    raise KeyboardInterrupt("not the user")


BAD_ANSWERS = {
    "exception": (lambda k: (0.0, 0.0) if k < 3 else _fail(k), "RuntimeError: sensor lost at step 3"),
    "nan": (lambda k: (math.nan, 0.0), "EgoError: ego 'scripted' answered (nan, 0.0) at 0.0 s"),
    "infinite": (lambda k: (0.0, -math.inf if k == 5 else 0.0), "answered (0.0, -inf) at 0.5 s"),
    "nothing": (lambda k: None, "TypeError"),
    "three numbers": (lambda k: (0.0, 0.0, 0.0), "ValueError"),
    "text": (lambda k: ("1.0", "0.0"), "TypeError"),
    "exit": (lambda k: sys.exit(3), "SystemExit: 3"),
    "an interrupt of its own": (lambda k: _interrupt(), "KeyboardInterrupt: not the user"),
    "an array for each": (lambda k: (np.zeros(2), np.zeros(2)), "TypeError"),
}


@pytest.mark.parametrize("case", BAD_ANSWERS)
def test_an_ego_that_fails_is_a_recorded_error_and_the_next_rollout_is_unaffected(
    simulate, make_scenario, draws, case
):
    answer, message = BAD_ANSWERS[case]
    scenario = make_scenario(TWO_SECONDS)
    x, noise_seeds = draws(scenario, 2)
    broken = [False]
    ego = ScriptedEgo(lambda k: answer(k) if broken[0] else (0.0, 0.0))
    simulator = simulate(scenario, ego)
    clean = simulator.run(x[1], noise_seeds[1])
    broken[0] = True
    failed = simulator.run(x[0], noise_seeds[0])
    broken[0] = False
    assert failed.outcome == "error"
    assert math.isnan(failed.f)
    assert message in failed.error
    assert same(simulator.run(x[1], noise_seeds[1]), clean)
    assert clean.outcome == "horizon"


@pytest.mark.parametrize("kind", [int, np.float32, np.float64, np.int8, bool])
def test_an_ego_may_answer_with_any_kind_of_number(simulate, make_scenario, draws, kind):
    scenario = make_scenario(TWO_SECONDS)
    x, noise_seeds = draws(scenario, 1)
    floats = simulate(scenario, ScriptedEgo(lambda k: (1.0, 0.0))).run(x[0], noise_seeds[0])
    others = simulate(scenario, ScriptedEgo(lambda k: (kind(1), kind(0)))).run(x[0], noise_seeds[0])
    assert same(floats, others)


def test_a_wrong_x_or_noise_is_an_error_and_the_next_rollout_is_unaffected(simulate, make_scenario, draws):
    scenario = make_scenario(TWO_SECONDS)
    x, noise_seeds = draws(scenario, 1)
    simulator = simulate(scenario)
    clean = simulator.run(x[0], noise_seeds[0])
    for wrong_x, wrong_noise in (
        (x[0][:-1], None),
        (np.full_like(x[0], np.nan), None),
        (x[0], np.zeros((19, 6, 2))),
        (x[0], np.zeros((20, 5, 2))),
    ):
        assert simulator.run(wrong_x, noise_seeds[0], action_noise=wrong_noise).outcome == "error"
        assert same(simulator.run(x[0], noise_seeds[0]), clean)


def test_the_ego_is_reset_with_the_rollout_s_seed(simulate, make_scenario, draws):
    scenario = make_scenario(TWO_SECONDS)
    x, noise_seeds = draws(scenario, 3)
    ego = ScriptedEgo(lambda k: (0.0, 0.0))
    simulator = simulate(scenario, ego)
    for row, seed in zip(x, noise_seeds, strict=True):
        simulator.run(row, seed)
    assert ego.seeds == noise_seeds


def test_noise_given_as_normals_is_the_noise_of_its_seed(simulate, make_scenario, draws):
    scenario = make_scenario()
    x, noise_seeds = draws(scenario, 1)
    simulator = simulate(scenario)
    given = simulator.run(x[0], action_noise=action_noise(noise_seeds[0], 100, 6))
    assert given.f == simulator.run(x[0], noise_seeds[0]).f
    assert given.f != simulator.run(x[0], noise_seeds[0] + 1).f


def test_frozen_noise_is_one_stream_for_all_rollouts(simulate, make_scenario, draws):
    scenario = make_scenario({'noise_mode = "drawn"': 'noise_mode = "frozen"'})
    x, noise_seeds = draws(scenario, 2)
    simulator = simulate(scenario)
    assert same(simulator.run(x[0], noise_seeds[0]), simulator.run(x[0], noise_seeds[1]))
    assert not same(simulator.run(x[0], noise_seeds[0]), simulator.run(x[1], noise_seeds[0]))


# the same bits ------------------------------------------------------------------------------------------------

SCRIPT = """
import json, sys
import numpy as np
from tests_bits import digests
from service.evaluation.job import make_job, Problem
from service.world.scenario import load_scenario
print(json.dumps(digests(load_scenario(sys.argv[1]), json.loads(sys.argv[2]))))
"""


def digests(scenario: Scenario, order: list[int]) -> dict[str, list]:
    """By row number: f, outcome and a digest of the whole trace, run in this order in one simulator."""
    problem = Problem(make_job(scenario, "idm", 0.5, "naive", 7, {"budget": 8}))
    x, noise_seeds = ce.draw(problem.base, 7, "estimate", 0, 0, 8)
    found: dict[str, list] = {}
    with problem.simulator() as simulator:
        for row in order:
            traced = trace.record(problem, simulator, x[row], int(noise_seeds[row]))
            parts = (traced.time_s, traced.agents, traced.ttc_s, traced.actions)
            digest = hashlib.sha256(
                b"".join(np.ascontiguousarray(part).tobytes() for part in parts)
            ).hexdigest()
            value = [np.float64(traced.rollout.f).tobytes().hex(), traced.rollout.outcome, digest]
            assert found.setdefault(str(row), value) == value, f"row {row} differs when run again"
    return found


@pytest.mark.parametrize("more", ["", BACKGROUND], ids=["alone", "with background"])
def test_the_same_rollout_gives_the_same_bits_in_any_order_and_in_another_process(
    make_scenario, scenario_text, tmp_path, more
):
    """Run first, run again after others, run in another order in another process."""
    path = tmp_path / "made.toml"
    path.write_text(scenario_text.replace("horizon_s = 10.0", "horizon_s = 3.0") + more, encoding="utf-8")
    scenario = make_scenario({"horizon_s = 10.0": "horizon_s = 3.0"}, more)
    here = digests(scenario, [0, 1, 2, 3, 2, 0, 0])
    script = SCRIPT.replace("tests_bits", Path(__file__).stem)
    folders = (str(Path(__file__).parents[3]), str(Path(__file__).parent))
    done = subprocess.run(
        [sys.executable, "-c", script, str(path), "[3, 1, 0, 2]"],
        capture_output=True,
        text=True,
        check=False,
        env=os.environ | {"PYTHONPATH": os.pathsep.join(folders)},
    )
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout.splitlines()[-1]) == here
    assert len({value[2] for value in here.values()}) == 4


def test_background_traffic_changes_what_happens(simulate, make_scenario, draws):
    plain, busy = make_scenario(), make_scenario(more=BACKGROUND)
    x, noise_seeds = draws(plain, 3)
    alone = [simulate(plain).run(row, seed).f for row, seed in zip(x, noise_seeds, strict=True)]
    among = [simulate(busy).run(row, seed).f for row, seed in zip(x, noise_seeds, strict=True)]
    assert alone != among


def test_the_users_own_interrupt_ends_the_run(simulate, make_scenario, draws, request):
    """Told by its signal, which comes while the ego thinks."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)  # whatever earlier tests have left
    request.addfinalizer(lambda: signal.signal(signal.SIGINT, before))
    scenario = make_scenario(TWO_SECONDS)
    x, noise_seeds = draws(scenario, 2)
    asked = [True]

    def answer(k: int) -> tuple[float, float]:
        if asked[0]:
            signal.raise_signal(signal.SIGINT)
        return 0.0, 0.0

    simulator = simulate(scenario, ScriptedEgo(answer))
    with pytest.raises(KeyboardInterrupt):
        simulator.run(x[0], noise_seeds[0])
    asked[0] = False
    assert simulator.run(x[0], noise_seeds[0]).error is None
