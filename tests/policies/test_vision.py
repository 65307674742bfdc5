"""The vision ego as it ships: it looks, it drives, and its card says how well."""

from __future__ import annotations

import math

import numpy as np
import onnx
import pytest

from policies import layout
from policies.drivers import WeightsError
from policies.egos import Observation, load_ego
from policies.egos.emergency import intervene
from policies.egos.vision import BESIDE, EMERGENCY, FRAME_SHAPE, WEIGHTS, VisionEgo, beside, vision_card
from service.world.camera import Camera, Weather, build_scene
from service.world.camera.sheet import traffic


@pytest.fixture(scope="module")
def ego() -> VisionEgo:
    return VisionEgo()


def test_it_is_given_speed_and_lidar_only():
    vector = np.arange(layout.OBSERVATION_SIZE, dtype=np.float64)
    given = beside(vector)
    assert given.shape == (BESIDE,)
    assert given[0] == layout.SPEED_MPS
    assert given[1:].tolist() == list(range(layout.RANGE_M, layout.OBSERVATION_SIZE))


@pytest.mark.parametrize("frame", [None, np.zeros((60, 80, 3), np.uint8)])
def test_without_the_right_picture_it_says_what_it_needs(ego, frame):
    with pytest.raises(ValueError, match="needs a picture of shape"):
        ego.act(Observation(np.zeros(layout.OBSERVATION_SIZE), 0.0, None, frame))


def test_weights_that_are_not_there_are_named(tmp_path):
    with pytest.raises(WeightsError, match=r"none\.onnx: no such weights file"):
        VisionEgo(tmp_path / "none.onnx")


def test_the_registry_makes_it_and_the_world_gives_it_pictures():
    assert load_ego("vision").name == "vision"
    assert load_ego("vision").wants_camera


@pytest.mark.parametrize("weather", [Weather(), Weather(sun_elevation_deg=-16.0), Weather(fog_per_km=15.0)])
def test_it_steers_back_to_its_lane_by_sight(ego, i80, weather):
    camera, scene = Camera(), build_scene(i80)
    vector = np.zeros(layout.OBSERVATION_SIZE)
    vector[layout.SPEED_MPS] = 15.0
    vector[layout.RANGE_M : layout.RANGE_RATE_MPS] = layout.LIDAR_RANGE_M
    mean = {}
    for turned in (-0.05, 0.05):
        turn_rates = []
        for station in range(300, 800, 50):
            poses = traffic(i80, float(station))[:1]
            poses[0, 2] += turned
            frame = camera.render(scene, poses, 0, weather, station)
            action = ego.act(Observation(vector, 0.0, None, frame))
            assert all(math.isfinite(value) for value in action)
            turn_rates.append(action[1])
        mean[turned] = np.mean(turn_rates)
    assert mean[-0.05] > 0.01
    assert mean[0.05] < -0.01


def test_the_same_picture_gets_the_same_answer(ego):
    frame = np.random.default_rng(0).integers(0, 256, FRAME_SHAPE, dtype=np.uint8)
    seen = Observation(np.zeros(layout.OBSERVATION_SIZE), 0.0, None, frame)
    assert ego.act(seen) == ego.act(seen) == VisionEgo().act(seen)


def test_weights_that_ask_for_it_brake_in_an_emergency_whatever_the_network_says(tmp_path):
    model = onnx.load(str(WEIGHTS))
    onnx.helper.set_model_props(model, {EMERGENCY: "yes"})
    onnx.save(model, str(tmp_path / "careful.onnx"))
    ego = VisionEgo(tmp_path / "careful.onnx")
    assert ego.emergency
    assert not load_ego("vision-paper").emergency
    frame = np.random.default_rng(2).integers(0, 256, FRAME_SHAPE, dtype=np.uint8)
    vector = np.zeros(layout.OBSERVATION_SIZE)
    vector[[layout.SPEED_MPS, layout.LENGTH_M, layout.WIDTH_M]] = 15.0, 4.5, 1.8
    vector[layout.RANGE_M : layout.RANGE_RATE_MPS] = layout.LIDAR_RANGE_M

    def alone(seen: np.ndarray) -> tuple[float, float]:
        given = {"frame": frame[None], "beside": beside(seen[None])}
        acceleration, turn_rate = ego._session.run(None, given)[0][0]
        return float(acceleration), float(turn_rate)

    assert ego.act(Observation(vector, 0.0, None, frame)) == alone(vector)
    vector[layout.RANGE_M], vector[layout.RANGE_RATE_MPS] = 8.0, -6.0  # straight ahead, a second away
    vector[layout.LANE_OFFSET_M] = 0.8  # which it does not know
    acted = ego.act(Observation(vector, 0.0, None, frame))
    blind = vector.copy()
    blind[layout.LANE_OFFSET_M] = 0.0
    assert acted == intervene(blind, *alone(vector))
    assert acted[0] < -3.0


def test_a_batch_answers_each_as_if_it_were_alone(ego):
    rng = np.random.default_rng(1)
    seen = []
    for _ in range(5):
        vector = rng.uniform(0.0, 30.0, layout.OBSERVATION_SIZE)
        seen.append(Observation(vector, 0.0, None, rng.integers(0, 256, FRAME_SHAPE, dtype=np.uint8)))
    blind = Observation(seen[0].vector, 0.0)
    answers = VisionEgo.act_batch([(ego, o) for o in [*seen[:2], blind, *seen[2:]]])
    refused = answers.pop(2)
    assert isinstance(refused, ValueError)
    assert answers == [pytest.approx(ego.act(o), rel=1e-4, abs=1e-6) for o in seen]


def test_its_card_has_figures_for_each_weather():
    card = vision_card()
    assert card["command"].startswith("tailroad train ego-vision")
    assert len(card["metrics"]) >= 6
    for figures in card["metrics"].values():
        for loop in ("i80_10s", "whole_road"):
            share = figures[loop]["off_road"]
            assert share["ci95"][0] <= share["value"] <= share["ci95"][1]
            assert figures[loop]["n"] > 0
