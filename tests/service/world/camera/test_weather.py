"""Weather as random variables of a scenario, and egos that are given pictures."""

from __future__ import annotations

import numpy as np
import pytest

import ce
from service.errors import ScenarioError
from service.world.camera import Weather, weather_of
from service.world.camera.weather import light_of
from service.world.scenario import load_scenario
from service.world.scenario.base import WEATHER, base_distribution, unpack
from service.world.sim.rollout import Simulator

WEATHER_TABLE = """
[weather]
sun_elevation_deg = { distribution = "uniform", low = -20.0, high = 70.0 }
sun_azimuth_deg = { distribution = "beta", alpha = 1.0, beta = 1.0, low = 0.0, high = 360.0 }
fog_per_km = { distribution = "beta", alpha = 1.0, beta = 12.0, low = 0.1, high = 80.0 }
rain_mmph = { distribution = "beta", alpha = 2.0, beta = 5.0, low = -12.0, high = 18.0 }
exposure_ev = { distribution = "beta", alpha = 4.0, beta = 4.0, low = -1.5, high = 1.5 }
"""


def test_only_scenarios_with_weather_have_its_coordinates(drivers):
    assert base_distribution(load_scenario("i80-paper"), drivers).dim == 428
    base = base_distribution(load_scenario("i80-paper-data"), drivers)
    assert base.dim == 433
    assert base.names[24:29] == tuple(f"weather.{key}" for key in WEATHER)
    assert base.names[29] == "xi[0]"


def test_a_draw_s_weather_and_driver_weights_are_kept_apart(drivers):
    scenario = load_scenario("i80-paper-data")
    x, _ = ce.draw(base_distribution(scenario, drivers), 1, "estimate", 0, 0, 1)
    weather = weather_of(scenario, x[0])
    assert [getattr(weather, key) for key in WEATHER] == x[0, 24:29].tolist()
    starts, weights = unpack(scenario, x[0])
    assert len(starts) == 6
    assert np.array_equal(weights, x[0, 29:])


def test_without_a_table_the_afternoon_is_clear():
    assert weather_of(load_scenario("i80-paper"), np.zeros(428)) == Weather()


@pytest.mark.parametrize(
    ("old", "new", "key"),
    [
        ("high = 70.0", "high = 170.0", "weather.sun_elevation_deg.high"),
        ("low = 0.1, high = 80.0", "low = -0.1, high = 80.0", "weather.fog_per_km.low"),
        ("low = -1.5, high = 1.5", "low = 1.5, high = 1.5", "weather.exposure_ev.low"),
        ("alpha = 2.0, beta = 5.0", "alpha = -2.0, beta = 5.0", "weather.rain_mmph.alpha"),
    ],
)
def test_weather_that_cannot_be_is_refused(make_scenario, old, new, key):
    with pytest.raises(ScenarioError, match=key):
        make_scenario(more=WEATHER_TABLE.replace(old, new))


@pytest.mark.parametrize(
    ("table", "key"),
    [
        ("[camera]\nwidth_px = 4", "camera.width_px"),
        ("[camera]\nhfov_deg = 179.0", "camera.hfov_deg"),
        ("[camera]\ndistortion = [0.1]", "camera.distortion"),
        ("[camera]\nfocal_px = 100.0", "focal_px"),
    ],
)
def test_a_camera_that_cannot_be_is_refused(make_scenario, table, key):
    with pytest.raises(ScenarioError, match=key):
        make_scenario(more="\n" + table + "\n")


def test_light_follows_the_sun_and_the_clouds():
    noon, night, rain = (light_of(w) for w in (Weather(60.0), Weather(-16.0), Weather(60.0, rain_mmph=10.0)))
    assert noon.sun.mean() > 1.0
    assert night.sun.max() == 0.0
    assert rain.sun.max() == 0.0
    assert night.lamps == 1.0
    assert noon.lamps == 0.0
    assert night.gain > noon.gain
    assert np.all(np.diff(rain.transmittance) <= 0.0)
    assert Weather(fog_per_km=39.12).visibility_m == pytest.approx(100.0)


class Watcher:
    name = "watcher"
    wants_camera = True

    def __init__(self) -> None:
        self.frames: list[np.ndarray] = []

    def reset(self, seed: int) -> None:
        self.frames = []

    def act(self, observation) -> tuple[float, float]:
        self.frames.append(observation.frame.copy())
        return 0.0, 0.0


def test_an_ego_that_wants_pictures_gets_one_a_step_in_the_weather_of_x(make_scenario, i80, drivers):
    scenario = make_scenario({"horizon_s = 10.0": "horizon_s = 0.5"}, more=WEATHER_TABLE)
    ego = Watcher()
    x, noise_seeds = ce.draw(base_distribution(scenario, drivers), 1, "estimate", 0, 0, 1)
    day, night = x[0].copy(), x[0].copy()
    day[24], night[24] = 50.0, -18.0
    with Simulator(scenario, i80, drivers, ego) as simulator:
        frames = []
        for draw in (day, night, day):
            rollout = simulator.run(draw, int(noise_seeds[0]))
            assert rollout.error is None
            assert rollout.steps == len(ego.frames) == 5
            frames.append(np.array(ego.frames))
    assert frames[0].shape == (5, 66, 200, 3)
    assert np.array_equal(frames[0], frames[2])
    assert frames[0].mean() > frames[1].mean() + 40.0
    assert not np.array_equal(frames[0][0], frames[0][1])
