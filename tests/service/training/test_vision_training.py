"""The vision ego's training: what it looks at, that an interrupted run goes on, and that the export drives the same."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from policies import layout
from policies.egos import Observation
from policies.egos.vision import FRAME_SHAPE, VisionEgo, beside

torch = pytest.importorskip("torch")

from service.training import ego_vision  # noqa: E402
from service.training.ego_vision_figures import outcomes  # noqa: E402
from service.training.ego_vision_network import VisionNet, export  # noqa: E402
from service.training.ego_vision_world import VisionWorld  # noqa: E402
from service.training.run import Stages  # noqa: E402
from service.world.camera import Weather  # noqa: E402
from service.world.sim import step  # noqa: E402


@pytest.fixture(scope="module")
def world() -> VisionWorld:
    return VisionWorld("drivers-gail")


@pytest.fixture(scope="module")
def exported(tmp_path_factory) -> tuple[VisionNet, Path]:
    torch.manual_seed(3)
    torch.set_num_threads(1)
    net = VisionNet()
    path = tmp_path_factory.mktemp("vision") / "untrained.onnx"
    export(net, path)
    return net, path


def test_the_exported_network_answers_as_the_trained_one(exported):
    net, path = exported
    rng = np.random.default_rng(1)
    ego = VisionEgo(path)
    for _ in range(5):
        frame = rng.integers(0, 256, FRAME_SHAPE, dtype=np.uint8)
        vector = rng.uniform(0.0, 50.0, layout.OBSERVATION_SIZE)
        with torch.no_grad():
            expected = net(torch.from_numpy(frame[None]), torch.from_numpy(beside(vector)[None]))[0].tolist()
        assert ego.act(Observation(vector, 0.0, None, frame)) == pytest.approx(expected, rel=1e-3, abs=1e-5)


def test_scattered_moments_are_sound_and_varied(world):
    states = world.scattered(300, np.random.default_rng(2))
    assert len(states) >= 300
    assert np.isfinite(states.poses).all()
    assert np.isfinite(states.seen).all()
    assert (states.seen[:, layout.INCIDENT] == 0.0).all()
    assert states.seen[:, layout.LANE_OFFSET_M].std() > 0.3
    assert states.seen[:, layout.SPEED_MPS].min() < 10.0 < 20.0 < states.seen[:, layout.SPEED_MPS].max()


def test_pictures_come_in_several_weathers(world):
    states = world.scattered(20, np.random.default_rng(2))
    frames = world.pictures(states, np.zeros(16, int), np.random.default_rng(5))
    assert frames.shape == (16, *FRAME_SHAPE)
    assert np.ptp(frames.reshape(16, -1).mean(axis=1)) > 10.0  # the same moment, four weathers


def test_an_interrupted_round_ends_with_the_same_network(world, tmp_path, monkeypatch):
    monkeypatch.setattr(ego_vision, "CHECKPOINT_STEPS", 2)
    arguments = ego_vision.Arguments(out=tmp_path / "a", batch=4)
    states = world.scattered(40, np.random.default_rng(0))
    stream = np.random.SeedSequence(9)
    ends = []
    for interrupted in (False, True):
        arguments = ego_vision.Arguments(out=tmp_path / str(interrupted), batch=4)
        stages = Stages(arguments)
        stages.path("x", "").parent.mkdir(parents=True)

        def train(net, stages=stages, arguments=arguments):
            ego_vision.learn(net, world, states, 4, 0, arguments, stages, stream, _Silent())

        torch.manual_seed(1)
        net = VisionNet()
        if interrupted:
            calls = []

            def once(*args, calls=calls, draw=world.pictures):
                calls.append(0)
                if len(calls) == 4:
                    raise KeyboardInterrupt
                return draw(*args)

            with monkeypatch.context() as patch:
                patch.setattr(world, "pictures", once)
                with pytest.raises(KeyboardInterrupt):
                    train(net)
            torch.manual_seed(77)
            net = VisionNet()
        train(net)
        ends.append(net.state_dict())
    assert all(torch.equal(ends[0][key], ends[1][key]) for key in ends[0])


class _Silent:
    def add_task(self, *_: object, **__: object) -> int:
        return 0

    def update(self, *_: object, **__: object) -> None:
        pass


def test_a_drive_of_an_untrained_network_is_recorded(world, exported):
    drive = world.drive(
        VisionEgo(exported[1]), Weather(), "i80-paper-10s", 30, np.random.default_rng(4), sway=1.0, every=5
    )
    assert drive.status in (step.RUNNING, step.OFF_ROAD, step.COLLIDED)
    assert 0 < len(drive.states) <= 6
    assert len(drive.offset_m) == len(drive.speed_mps) <= 30
    summary = outcomes([drive])
    assert summary["n"] == 1
    assert summary["off_road"]["ci95"][0] <= summary["off_road"]["value"] <= summary["off_road"]["ci95"][1]
