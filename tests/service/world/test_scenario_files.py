"""The built-in scenarios, what they mean to the world, and that they agree with each other."""

from __future__ import annotations

import math
import re

import msgspec
import numpy as np
import pytest

import ce
from service.errors import ScenarioError
from service.world.scenario import built_in_names, load_scenario
from service.world.scenario.base import base_distribution, dimension, unpack
from service.world.scenario.check import check_road
from service.world.scenario.load import FOLDER, digest


@pytest.mark.parametrize("name", built_in_names())
def test_a_built_in_scenario_loads_and_its_road_carries_it(name):
    scenario = load_scenario(name)
    assert scenario.name == name
    corridor = check_road(scenario, name)
    assert corridor.name == scenario.network.road


def test_the_paper_s_scenario_and_its_short_form_are_there():
    assert {"i80", "i80-10s", "i80-paper", "i80-paper-10s"} <= set(built_in_names())


def test_the_short_scenario_differs_in_name_description_and_horizon_only():
    long, short = (msgspec.to_builtins(load_scenario(name)) for name in ("i80-paper", "i80-paper-10s"))
    assert short["time"].pop("horizon_s") == 10.0
    assert long["time"].pop("horizon_s") == 400.0
    for scenario in (long, short):
        del scenario["name"], scenario["description"]
    assert long == short


def test_the_base_distribution_is_the_paper_s(drivers):
    scenario = load_scenario("i80-paper")
    base = base_distribution(scenario, drivers)
    assert base.dim == dimension(scenario) == 6 * 4 + 404
    expected = [(80.0, 120.0), (-0.25, 0.25), (-3.6, 3.6), (10.0, 20.0)] * 6
    assert [(block.low, block.high) for block in base.blocks[:-1]] == expected
    assert {(block.alpha, block.beta) for block in base.blocks[:-1]} == {(2.0, 2.0)}
    assert np.array_equal(base.blocks[-1].mean, drivers.mu0)
    assert np.array_equal(base.blocks[-1].cov, drivers.sigma0)
    assert base.names[:5] == (
        "ego.station_m",
        "ego.lane_offset_m",
        "ego.heading_deg",
        "ego.speed_mps",
        "env1.station_m",
    )


def test_a_draw_is_unpacked_into_starts_and_driver_weights(drivers):
    scenario = load_scenario("i80-paper")
    x, _ = ce.draw(base_distribution(scenario, drivers), 1, "estimate", 0, 0, 1)
    starts, weights = unpack(scenario, x[0])
    assert [start.lane for start in starts] == [2, 0, 1, 3, 4, 5]
    assert scenario.ego == 0
    assert starts[1].station_m == x[0, 4]
    assert starts[1].lane_offset_m == x[0, 5]
    assert starts[1].lane_heading_rad == pytest.approx(math.radians(x[0, 6]), rel=1e-15)
    assert starts[1].speed_mps == x[0, 7]
    assert np.array_equal(weights, x[0, 24:])


def test_a_vehicle_s_own_values_outrank_those_for_all(make_scenario):
    own = (
        'name = "env6"\nlane = 6\nlength_m = 12.0\n'
        'speed_mps = { distribution = "beta", alpha = 3.0, beta = 2.0, low = 1.0, high = 2.0 }'
    )
    scenario = make_scenario({'name = "env6"\nlane = 6': own})
    truck, car = scenario.vehicles[5], scenario.vehicles[4]
    assert scenario.of(truck, "length_m") == 12.0
    assert scenario.of(truck, "speed_mps").high == 2.0
    assert scenario.of(truck, "width_m") == scenario.of(car, "width_m") == 1.8
    assert scenario.of(car, "speed_mps").high == 20.0


def test_the_ego_may_be_any_vehicle(make_scenario):
    scenario = make_scenario(
        {'role = "ego"\n': "", 'name = "env4"\nlane = 4': 'name = "env4"\nrole = "ego"\nlane = 4'}
    )
    assert scenario.ego == 3


def test_paths_are_relative_to_the_scenario_s_file(tmp_path, scenario_text, weights_file):
    folder = tmp_path / "mine"
    folder.mkdir()
    text = scenario_text.replace(f'weights = "{weights_file}"', 'weights = "../w.safetensors"')
    (folder / "s.toml").write_text(
        text.replace('road = "i80"', 'road = "n.net.xml"\nedges = ["a"]'), encoding="utf-8"
    )
    scenario = load_scenario(str(folder / "s.toml"))
    assert scenario.drivers.weights == str(tmp_path / "w.safetensors")
    assert scenario.network.road == str(folder / "n.net.xml")


def test_the_digest_is_that_of_what_the_file_says(make_scenario):
    assert digest(make_scenario()) == digest(make_scenario({"# The paper's base": "# Another comment"}))
    assert digest(make_scenario()) != digest(make_scenario({"rays = 20": "rays = 21"}))


def test_a_misspelt_built_in_name_is_answered_with_the_right_one():
    with pytest.raises(ScenarioError, match=r"i80-10: no scenario of that name .* did you mean 'i80-10s'\?"):
        load_scenario("i80-10")


@pytest.mark.parametrize(
    "name", ["", ".", "..", "a\0b", "x" * 5000, "x" * 5000 + ".toml", "/dev/null", str(FOLDER)]
)
def test_a_name_that_no_scenario_can_have_is_a_scenario_error(name):
    with pytest.raises(ScenarioError, match="no such file"):
        load_scenario(name)


def test_a_scenario_read_from_a_built_in_file_by_its_path_is_the_same():
    assert load_scenario(str(FOLDER / "i80.toml")) == load_scenario("i80")


def test_marginals_can_be_uniform_or_truncated_normal(tmp_path, drivers):
    text = (FOLDER / "i80-paper-10s.toml").read_text(encoding="utf-8")
    text = re.sub(
        r"(?m)^station_m = .*", 'station_m = { distribution = "uniform", low = 80.0, high = 90.0 }', text
    )
    normal = '{ distribution = "truncated-normal", mean = 15.0, deviation = 2.0, low = 10.0, high = 20.0 }'
    text = re.sub(r"(?m)^speed_mps = .*", f"speed_mps = {normal}", text)
    path = tmp_path / "mine.toml"
    path.write_text(text, encoding="utf-8")
    scenario = load_scenario(str(path))
    base = base_distribution(scenario, drivers)
    assert base.blocks[0] == ce.Uniform(80.0, 90.0)
    assert base.blocks[3] == ce.TruncatedNormal(15.0, 2.0, 10.0, 20.0)
