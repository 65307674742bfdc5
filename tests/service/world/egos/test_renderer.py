"""Pictures made in another process: the same bits as in this one, and what a renderer refuses."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import ce
from policies.egos import Observation
from service.world.egos import ego_pb2 as pb
from service.world.egos.open import camera_elsewhere
from service.world.egos.renderer import Rendering
from service.world.egos.settings import EgoSettings
from service.world.scenario.base import base_distribution
from service.world.scenario.load import digest
from service.world.sim.rollout import Simulator

ROOT = Path(__file__).parents[4]


class Looking:
    """Drives by what it sees, and keeps it."""

    name = "looking"
    wants_camera = True

    def reset(self, seed: int) -> None:
        self.frames: list[np.ndarray] = []

    def act(self, observation: Observation) -> tuple[float, float]:
        assert observation.frame is not None
        self.frames.append(observation.frame.copy())
        return float(observation.frame.mean()) / 255.0 - 0.5, 0.0


@pytest.fixture(scope="module")
def scenario_file(scenario_text, tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("renderer") / "short.toml"
    path.write_text(scenario_text.replace("horizon_s = 10.0", "horizon_s = 0.5"), encoding="utf-8")
    return path


@pytest.fixture(scope="module")
def scenario(make_scenario):
    return make_scenario({"horizon_s = 10.0": "horizon_s = 0.5"})


def test_a_rollout_with_the_renderer_in_another_process_has_the_same_bits(
    scenario, scenario_file, i80, drivers, address
):
    x, noise_seeds = ce.draw(base_distribution(scenario, drivers), 3, "estimate", 0, 0, 2)
    settings = EgoSettings(renderer=address, deadline_s=120.0, patience_s=120.0)
    command = [sys.executable, "-m", "service.world.egos.renderer", str(scenario_file), "--listen", address]
    found = {}
    with subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, text=True) as renderer:
        try:
            assert renderer.stdout is not None
            assert "is ready" in renderer.stdout.readline()
            for where, opener in (("here", None), ("there", camera_elsewhere(scenario, settings))):
                ego = Looking()
                with Simulator(scenario, i80, drivers, ego, open_camera=opener) as simulator:
                    rollouts, frames = [], []
                    for row, seed in zip(x, noise_seeds, strict=True):
                        rollouts.append(simulator.run(row, int(seed)))
                        frames += ego.frames
                found[where] = rollouts, np.array(frames)
        finally:
            renderer.kill()
    assert found["here"][0] == found["there"][0]
    assert all(rollout.error is None for rollout in found["here"][0])
    assert found["here"][1].shape == (10, 66, 200, 3)
    assert np.array_equal(found["here"][1], found["there"][1])


def test_a_missing_renderer_is_a_recorded_error(scenario, i80, drivers, address):
    x, noise_seeds = ce.draw(base_distribution(scenario, drivers), 3, "estimate", 0, 0, 1)
    opener = camera_elsewhere(scenario, EgoSettings(renderer=address, patience_s=0.2))
    with Simulator(scenario, i80, drivers, Looking(), open_camera=opener) as simulator:
        rollout = simulator.run(x[0], int(noise_seeds[0]))
    assert rollout.error is not None
    assert "can be reached at" in rollout.error


def test_pictures_are_made_in_this_process_unless_a_renderer_is_named(scenario):
    assert camera_elsewhere(scenario, EgoSettings()) is None


def test_a_renderer_refuses_what_makes_no_sense(scenario, i80):
    answers = Rendering(scenario, i80)
    good = pb.Render(worker="a", scenario=digest(scenario), pose=[0.0, 0.0, 0.0, 4.5, 1.8, 0.0], seed=1)

    def said(**changes) -> str:
        render = pb.Render()
        render.CopyFrom(good)
        for name, value in changes.items():
            if isinstance(value, list):
                del getattr(render, name)[:]
                getattr(render, name).extend(value)
            else:
                setattr(render, name, value)
        (reply,) = answers.answer([pb.Request(render=render).SerializeToString()])
        return reply.refusal.reason

    assert said() == ""
    assert "not the one" in said(scenario="other")
    assert "not finite" in said(pose=[float("nan")] * 6)
    assert "not finite" in said(weather=[float("inf")] * 5)
    assert "6 numbers each" in said(pose=[1.0] * 7)
    assert "6 numbers each" in said(pose=[])
    assert "no vehicle 1" in said(ego=1)
    assert "5 numbers, not 3" in said(weather=[1.0] * 3)
    (reply,) = answers.answer([b"\xff"])
    assert "not a Request" in reply.refusal.reason
    (reply,) = answers.answer([pb.Request(reset=pb.Reset(worker="a")).SerializeToString()])
    assert "nothing else" in reply.refusal.reason
