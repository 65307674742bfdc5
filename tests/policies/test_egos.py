"""What every ego policy must do, and what each of them does."""

from __future__ import annotations

import hashlib
import json
import math
import shutil

import numpy as np
import pytest

from policies import egos, layout
from policies.drivers import WEIGHTS_FOLDER, load_drivers
from policies.egos import Observation, ego_digest, ego_names, ego_weights, load_ego, registry
from policies.egos.idm import DESIRED_SPEED_MPS, IdmEgo
from policies.egos.lidar import LidarEgo
from policies.egos.vision import FRAME_SHAPE
from policies.idm import idm_action


def observations(n: int) -> list[np.ndarray]:
    generator = np.random.default_rng(11)
    made = []
    for _ in range(n):
        vector = np.zeros(layout.OBSERVATION_SIZE)
        vector[: layout.LANE_TO_THE_LEFT] = [
            *generator.normal(size=2) * 0.2,
            generator.uniform(0, 30),
            4.5,
            1.8,
            0,
            1.8,
            1.8,
        ]
        vector[layout.RANGE_M : layout.RANGE_RATE_MPS] = generator.uniform(2.0, 100.0, layout.BEAMS)
        vector[layout.RANGE_RATE_MPS :] = generator.normal(size=layout.BEAMS) * 5.0
        made.append(vector)
    return made


FRAME = np.random.default_rng(12).integers(0, 256, FRAME_SHAPE, dtype=np.uint8)


@pytest.fixture(params=ego_names())
def ego(request, drivers) -> egos.EgoPolicy:
    return LidarEgo(drivers) if request.param == "lidar" else load_ego(request.param)


def test_an_ego_answers_two_finite_numbers(ego):
    ego.reset(0)
    for k, vector in enumerate(observations(50)):
        acceleration, turn_rate = ego.act(Observation(vector, 0.1 * k, frame=FRAME))
        assert isinstance(acceleration, float)
        assert isinstance(turn_rate, float)
        assert math.isfinite(acceleration)
        assert math.isfinite(turn_rate)


def test_an_ego_leaves_the_observation_as_it_is(ego):
    for vector in observations(5):
        before = vector.copy()
        ego.act(Observation(vector, 0.0, frame=FRAME))
        assert np.array_equal(vector, before)


def test_a_reset_with_the_same_seed_gives_the_same_drive(ego):
    drives = []
    for _ in range(2):
        ego.reset(5)
        drives.append(
            [ego.act(Observation(vector, 0.1 * k, frame=FRAME)) for k, vector in enumerate(observations(20))]
        )
    assert drives[0] == drives[1]


def test_the_names_of_the_protocol_and_the_registry_agree(ego):
    assert ego.name in ego_names()


def test_weights_with_their_card_make_an_ego():
    assert ego_names() == ["idm", "lidar", "lidar-paper", "vision", "vision-paper"]
    for name in ego_names():
        assert load_ego(name).name == name
        path = ego_weights(name)
        if name == "idm":
            assert path is None
            assert ego_digest(name) == ""
        else:
            assert json.loads(path.with_suffix(".json").read_text())["name"] == path.stem == f"ego-{name}"
            assert ego_digest(name) == hashlib.sha256(path.read_bytes()).hexdigest()


def test_a_further_file_is_a_further_ego(tmp_path, monkeypatch):
    monkeypatch.setattr(registry, "WEIGHTS_FOLDER", tmp_path)
    assert ego_names() == ["idm"]
    for suffix in (".safetensors", ".json"):
        shutil.copy(WEIGHTS_FOLDER / f"ego-lidar{suffix}", tmp_path / f"ego-mine{suffix}")
    assert ego_names() == ["idm", "mine"]
    vector = observations(1)[0]
    mine = load_ego("mine")
    monkeypatch.undo()
    assert mine.act(Observation(vector, 0.0)) == load_ego("lidar").act(Observation(vector, 0.0))
    with pytest.raises(ValueError, match="did you mean 'lidar'"):
        load_ego("lidr")


def test_the_idm_ego_is_the_intelligent_driver_at_the_speed_limit():
    assert pytest.approx(55 * 1609.344 / 3600, abs=0.02) == DESIRED_SPEED_MPS
    for vector in observations(20):
        assert IdmEgo().act(Observation(vector, 0.0)) == idm_action(vector, DESIRED_SPEED_MPS)


def test_the_lidar_ego_drives_with_the_mean_of_its_network(weights_file):
    model = load_drivers(weights_file)
    for vector in observations(20):
        hidden = np.maximum(vector @ model.w1 + model.b1, 0.0)
        hidden = np.maximum(hidden @ model.w2 + model.b2, 0.0)
        mean = np.append(hidden, 1.0) @ model.mu0.reshape(101, 4)
        expected = model.action_scale * mean[:2]
        assert LidarEgo(model).act(Observation(vector, 0.0)) == pytest.approx(expected, rel=1e-4, abs=1e-5)


def test_an_unknown_name_is_refused_with_the_nearest_one():
    with pytest.raises(ValueError, match=r"no ego named 'lidr'; did you mean 'lidar'\? there are .*idm.*"):
        load_ego("lidr")


def test_a_name_like_nothing_known_is_refused_with_all_names():
    with pytest.raises(
        ValueError,
        match=r"no ego named 'os\.system'; there are idm, lidar, lidar-paper, vision, vision-paper",
    ):
        load_ego("os.system")


def test_each_load_gives_an_ego_of_its_own():
    assert load_ego("idm") is not load_ego("idm")
