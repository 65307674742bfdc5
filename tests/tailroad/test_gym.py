"""Scenarios as Gymnasium environments: clean by the checkers, rollouts of a naive run, policies that become egos."""

from __future__ import annotations

import warnings

import gymnasium
import numpy as np
import pytest
import torch
from gymnasium.utils.env_checker import check_env
from stable_baselines3.common.env_checker import check_env as check_for_baselines

import tailroad.gym
from policies.egos import Observation
from policies.egos.onnx_file import OnnxEgo
from service.errors import InputError
from service.evaluation.job import Problem, make_job
from service.world.environment import HIGH, LOW, Step, TrafficEnv, default_reward
from service.world.scenario import load_scenario


@pytest.mark.parametrize(
    "options", [{}, {"scaled": True}, {"observation": "camera", "render_mode": "rgb_array"}]
)
def test_the_checkers_of_gymnasium_and_stable_baselines_find_nothing(options):
    env = gymnasium.make("tailroad/I80-v0", **options)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(env.unwrapped)
        check_for_baselines(env.unwrapped, warn=options.get("observation") != "camera")


def test_an_episode_is_the_naive_rollout_of_its_seed_and_row_to_the_bit():
    class Again:
        """Answers what was done in an episode."""

        name = "again"

        def __init__(self, actions):
            self.actions, self.seen = actions, []

        def reset(self, seed):
            self.k = 0

        def act(self, observation: Observation):
            self.seen.append(observation.vector.astype(np.float32))
            self.k += 1
            return self.actions[self.k - 1]

    env = TrafficEnv("i80-10s")
    env.reset(seed=7)
    observed, info = env.reset()
    assert info["rollout"] == (7, 1)
    rng, done, actions, seen = np.random.default_rng(1), False, [], []
    while not done:
        seen.append(observed)
        action = rng.uniform(-0.3, 0.3, 2)
        actions.append(env.physical(action))
        observed, _, terminated, truncated, info = env.step(action)
        done = terminated or truncated
    problem = Problem(
        make_job(load_scenario("i80-10s"), "idm", gamma=0.0, method="naive", seed=7, options={})
    )
    import ce

    x, noise = ce.draw(problem.base, 7, "estimate", 0, 1, 2)
    ego = Again(actions)
    with problem.simulator(ego=ego) as simulator:
        rollout = simulator.run(x[0], int(noise[0]))
    assert (rollout.f, rollout.outcome, rollout.steps) == (info["f"], info["outcome"], len(actions))
    assert np.array_equal(np.clip(ego.seen, LOW, HIGH).astype(np.float32), seen)
    again, told = env.reset(options={"rollout": (7, 1)})
    assert told["rollout"] == (7, 1)
    assert np.array_equal(again, seen[0])


def test_a_policy_becomes_an_ego_that_does_the_same(tmp_path):
    torch.manual_seed(1)
    env = TrafficEnv("i80-10s", scaled=True, max_turn_rate_radps=0.1)
    actor = torch.nn.Sequential(torch.nn.Linear(51, 16), torch.nn.Tanh(), torch.nn.Linear(16, 2))
    ego = OnnxEgo(tailroad.gym.export_policy(actor, env, tmp_path / "made" / "policy.onnx"))
    for seed in range(20):
        scaled, _ = env.reset(seed=seed)
        vector = env._world.observations[env._world.ego]
        with torch.no_grad():
            action = actor(torch.tensor(scaled)[None])[0].numpy()
        assert ego.act(Observation(vector, 0.0, np.zeros(1))) == pytest.approx(env.physical(action), abs=1e-5)


def test_full_actions_are_the_limits_and_a_bad_end_costs_more_than_all_speed():
    env = TrafficEnv("i80-10s")
    assert env.physical([1.0, 1.0]) == (4.0, 0.05)
    assert env.physical([-7.0, -1.0]) == (-8.0, -0.05)
    ahead = Step(25.0, (0.0, 0.0), np.inf, None, 0.1)
    assert default_reward(ahead) == pytest.approx(0.1)
    assert default_reward(ahead._replace(ttc_s=1.5)) == pytest.approx(0.05)
    assert default_reward(ahead._replace(outcome="collision")) == pytest.approx(-9.9)
    assert default_reward(ahead._replace(action=(-6.0, 0.0))) < default_reward(
        ahead._replace(action=(-1.0, 0.0))
    )


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"observation": "radar"}, "state"),
        ({"max_turn_rate_radps": 0.0}, "above 0"),
        ({"render_mode": "human"}, "rgb_array"),
    ],
)
def test_options_that_are_none_are_refused(options, said):
    with pytest.raises(InputError, match=said):
        TrafficEnv("i80-10s", **options)


def test_a_step_without_an_episode_is_refused():
    with pytest.raises(RuntimeError, match="reset"):
        TrafficEnv("i80-10s").step([0.0, 0.0])
