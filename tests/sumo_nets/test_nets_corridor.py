"""Lane geometry as arrays: the built-in I-80, and networks of a user's."""

from __future__ import annotations

import numpy as np
import pytest

from sumo_nets.corridor import Corridor, NetworkError, load_corridor


@pytest.fixture(scope="module")
def i80() -> Corridor:
    return load_corridor("i80")


def assert_consistent(road: Corridor) -> None:
    count = len(road.station_m)
    assert np.array_equal(road.station_m, np.arange(count) * road.ds_m)
    assert road.length_m == road.station_m[-1]
    for name in ("ref_x", "ref_y", "ref_heading", "ref_curvature", "road_left", "road_right"):
        array = getattr(road, name)
        assert array.shape == (count,)
        assert array.dtype == np.float64
        assert array.flags.c_contiguous
        assert np.isfinite(array).all()
    present = road.sumo_lane >= 0
    for array in (road.lane_left, road.lane_right):
        assert array.shape == present.shape
        assert array.flags.c_contiguous
        assert np.array_equal(np.isfinite(array), present)
    assert np.array_equal(road.edge_index >= 0, present)
    assert road.edge_index.dtype == road.sumo_lane.dtype == np.int32
    assert np.array_equal(road.road_left, np.nanmax(road.lane_left, axis=0))
    assert np.array_equal(road.road_right, np.nanmin(road.lane_right, axis=0))
    # even spacing along the arc, and each lane's left neighbour touches it
    chord = np.hypot(np.diff(road.ref_x), np.diff(road.ref_y))
    arc = np.cumsum(chord / np.sinc(np.diff(road.ref_heading) / (2 * np.pi)))
    assert np.abs(arc - road.station_m[1:]).max() < 1e-3
    gap = road.lane_right[:-1] - road.lane_left[1:]
    assert (np.abs(gap[np.isfinite(gap)]) < 0.02).all()


def assert_round_trip(road: Corridor) -> None:
    rng = np.random.default_rng(1)
    station = rng.uniform(0.0, road.length_m, 5000)
    offset = rng.uniform(road.road_right.min() - 3.0, road.road_left.max() + 3.0, 5000)
    x, y, _ = road.to_xy(station, offset)
    station_again, offset_again = road.project(x, y)
    assert np.abs(station_again - station).max() < 1e-6
    assert np.abs(offset_again - offset).max() < 1e-6


def test_i80_is_six_lanes_of_12_feet_over_two_kilometres(i80):
    assert_consistent(i80)
    assert 2000.0 <= i80.length_m <= 2100.0
    assert i80.lane_count == 7
    assert (i80.sumo_lane[:6] >= 0).all()
    width = i80.lane_left - i80.lane_right
    assert np.nanmax(np.abs(width - 3.66)) < 1e-3


def test_i80_is_smooth_enough_to_drive(i80):
    assert np.abs(i80.ref_curvature).max() < 1 / 400
    assert np.abs(np.diff(i80.ref_curvature)).max() < 1e-4
    assert np.abs(np.gradient(i80.ref_heading, i80.ds_m) - i80.ref_curvature).max() < 1e-5
    assert np.nanmax(np.abs(np.diff(i80.lane_left[:6], axis=1))) < 3e-4


def test_i80_has_lane_seven_only_at_the_ramps(i80):
    stations = i80.station_m[i80.sumo_lane[6] >= 0]
    assert stations.min() == pytest.approx(835.0, abs=1.0)
    assert stations.max() == pytest.approx(1270.0, abs=3.0)  # each joint of edges shortens the road by 0.1 m
    assert not ((stations > 950) & (stations < 1199)).any()
    assert set(i80.lanes_at(np.array([0.0, 900.0, 1100.0, 1250.0, 2050.0])).tolist()) == {6, 7}
    with pytest.raises(NetworkError, match="no lane 7 at station 100"):
        i80.sumo_position(6, 100.0)


def test_a_kernels_tangent_projection_at_the_nearest_station_is_accurate(i80):
    station, offset = np.linspace(1.0, 2049.0, 4001), np.tile([-9.15, 0.0, 9.15], 1334)[:4001]
    x, y, _ = i80.to_xy(station, offset)
    k = i80.nearest_station(station)
    dx, dy = x - i80.ref_x[k], y - i80.ref_y[k]
    c, s = np.cos(i80.ref_heading[k]), np.sin(i80.ref_heading[k])
    assert np.abs(k * i80.ds_m + c * dx + s * dy - station).max() < 0.01
    assert np.abs(c * dy - s * dx - offset).max() < 0.001


def test_projection_undoes_placement(i80):
    assert_round_trip(i80)


def test_points_beyond_the_ends_are_projected_beyond_them(i80):
    x, y, _ = i80.to_xy(np.array([-5.0, i80.length_m + 7.0]), 1.0)
    station, offset = i80.project(x, y)
    assert station == pytest.approx([-5.0, i80.length_m + 7.0], abs=1e-6)
    assert offset == pytest.approx([1.0, 1.0], abs=1e-6)


def test_lane_at_finds_the_lane_whose_centre_is_given(i80):
    for lane in range(6):
        assert (i80.lane_at(i80.station_m, i80.lane_center(lane, i80.station_m)) == lane).all()
    assert i80.lane_at(10.0, 30.0) == -1
    assert np.isnan(i80.lane_center(6, 10.0))
    assert i80.lane_width(0, 10.5) == pytest.approx(3.66, abs=1e-3)


def test_a_straight_network_of_a_users(straight):
    road = load_corridor(straight, ["west", "east"])
    assert_consistent(road)
    assert_round_trip(road)
    assert road.name == "straight"
    assert road.length_m == pytest.approx(450.0, abs=1.0)
    assert (road.sumo_lane >= 0).all()  # no hole in the 12 m between the edges
    assert np.abs(np.diff(road.lane_left, axis=1)).max() < 0.05
    assert road.lane_width(5, 20.0) == pytest.approx(3.66, abs=0.01)
    assert road.lane_width(5, 400.0) == pytest.approx(4.66, abs=0.01)
    assert road.sumo_position(0, 10.0) == ("west", 5)
    assert road.sumo_position(5, 440.0) == ("east", 0)


def test_a_bend_drawn_with_kinks_comes_out_smooth(bend):
    road = load_corridor(bend, ["a", "b", "c"])
    assert_consistent(road)
    assert_round_trip(road)
    assert road.ref_curvature[40:-40] == pytest.approx(1.0 / 300.0, rel=0.05)
    assert np.abs(np.diff(road.ref_curvature)).max() < 3e-4
    assert np.abs(np.diff(road.ref_heading)).max() < 0.005


def test_lanes_that_begin_and_end_keep_the_numbering_of_their_neighbours(bend):
    road = load_corridor(bend, ["a", "b", "c"])
    assert road.lane_count == 4
    assert road.sumo_position(1, 10.0) == ("a", 2)
    assert road.sumo_position(1, 500.0) == ("c", 1)
    assert road.sumo_position(0, 500.0) == ("c", 2)
    assert road.sumo_lane[0, 10] == -1
    assert road.sumo_lane[3, 500] == -1
    assert np.nanmax(np.abs(np.diff(road.lane_left, axis=1))) < 0.02


def test_one_edge_is_a_corridor_too(straight):
    road = load_corridor(straight, ["ramp"])
    assert_consistent(road)
    assert road.lane_count == 1


def test_a_missing_network_is_reported():
    with pytest.raises(NetworkError, match=r"no network file .*nowhere\.net\.xml"):
        load_corridor("nowhere.net.xml", ["a"])


def test_a_file_that_is_no_network_is_reported(tmp_path):
    for text in ("not xml", "<net></net>", "<routes/>"):
        (tmp_path / "bad.net.xml").write_text(text)
        with pytest.raises(NetworkError, match="bad"):
            load_corridor(tmp_path / "bad.net.xml", ["a"])


def test_edges_must_be_named_for_a_users_network(straight):
    for none in (None, []):
        with pytest.raises(NetworkError, match="name the edges"):
            load_corridor(straight, none)


def test_an_unknown_edge_is_reported_with_the_known_ones(straight):
    with pytest.raises(NetworkError, match=r"no edge 'north'.*west"):
        load_corridor(straight, ["west", "north"])


def test_edges_that_do_not_follow_each_other_are_reported(straight):
    with pytest.raises(NetworkError, match="'east' does not lead to 'west'; it leads to nothing"):
        load_corridor(straight, ["east", "west"])
    with pytest.raises(NetworkError, match="'i80_south_1' does not lead to 'i80_north_1'"):
        load_corridor("i80", ["i80_south_1", "i80_north_1"])
