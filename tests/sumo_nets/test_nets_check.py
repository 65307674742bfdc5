"""The check passes the built-in road, and says what is wrong with others."""

from __future__ import annotations

import json

import numpy as np
import pytest

from sumo_nets.check import check, distance_to_lane, reference_lines
from sumo_nets.corridor import BUILT_IN, NetworkError, load_corridor
from sumo_nets.plot import plot


@pytest.mark.parametrize("name", BUILT_IN)
def test_a_built_in_road_passes(name):
    report = check(name)
    assert report.passed, str(report)
    assert json.loads(json.dumps(report.to_dict()))["passed"] is True
    assert "lane connections" in str(report)


@pytest.mark.parametrize(("lane", "from_m"), [(1, 0.0), (2, 0.0), (3, 567.0), (4, 567.0)])
def test_i80_follows_the_lane_lines_of_the_cad_drawing(lane, from_m):
    line = reference_lines("i80")[f"cad/centerline{lane}"]
    _, apart = distance_to_lane(load_corridor("i80"), line, lane, from_m, 1470.0)
    assert np.median(np.abs(apart)) < 0.05
    assert np.abs(apart).max() < 0.2


def test_i80_ends_on_the_carriageway_of_openstreetmap():
    line = reference_lines("i80")["osm/i80_downstream_n_2"]
    _, apart = distance_to_lane(load_corridor("i80"), line, 3, 1870.0, 2050.0)
    assert np.abs(apart).max() < 0.2


def test_a_users_network_is_checked_against_defaults(straight):
    report = check(straight, ["west", "east"])
    assert report.passed, str(report)
    assert report.name == "straight"


def test_a_lane_without_a_connection_fails(write_net):
    edges = {
        "a": (np.array([[0.0, 0.0], [100.0, 0.0]]), [3.5] * 2),
        "b": (np.array([[101.0, 0.0], [200.0, 0.0]]), [3.5] * 2),
    }
    report = check(write_net("gap", edges, [("a", "b", 1, 1)]), ["a", "b"])
    assert not report.passed
    failed = {item.name: item.found for item in report.items if not item.passed}
    assert failed["lane connections"] == "lane 2 from a to b"


def test_narrow_lanes_fail(write_net):
    path = write_net("narrow", {"a": (np.array([[0.0, 0.0], [100.0, 0.0]]), [2.0] * 2)}, [])
    assert [item.name for item in check(path, ["a"]).items if not item.passed] == ["lane width"]


def test_a_line_that_is_elsewhere_is_reported():
    road, line = load_corridor("i80"), reference_lines("i80")["cad/centerline6"]
    with pytest.raises(NetworkError, match="does not reach stations"):
        distance_to_lane(road, line, 6, 1800.0, 1900.0)


def test_pictures_are_drawn(straight, tmp_path):
    assert plot(straight, tmp_path / "straight.png", ["west", "east"]).stat().st_size > 10_000
    assert plot("i80", tmp_path / "i80.png").stat().st_size < 300_000
