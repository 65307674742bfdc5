"""Projection of vehicles to the road: station, lane, offset and markings over the whole of I-80."""

from __future__ import annotations

import math

import numpy as np
import pytest

from service.world import agents as A
from service.world.sim.projection import REF_X, locate, place
from service.world.sim.road import Road, road_of
from sumo_nets.corridor import Corridor, load_corridor

CENTIMETRE = 0.01


def located(agent: np.ndarray, road: Road) -> np.ndarray:
    locate(agent, road.reference, road.lanes, road.spacing_m)
    return agent


def placed(road: Road, station: float, lane: int, offset: float = 0.0, heading: float = 0.0) -> np.ndarray:
    agent = np.zeros(A.COLUMNS)
    place(agent, station, lane, offset, heading, road.reference, road.lanes, road.spacing_m)
    return located(agent, road)


def station_of(agent: np.ndarray, road: Road) -> float:
    return agent[A.STATION] * road.spacing_m + agent[A.ALONG_M]


def at(road: Road, i80: Corridor, station: float, offset: float, guess: int | None = None) -> np.ndarray:
    """A vehicle at a station and an offset from the reference line, by the corridor's own geometry."""
    x, y, heading = i80.to_xy(station, offset)
    agent = np.zeros(A.COLUMNS)
    agent[[A.X_M, A.Y_M, A.HEADING_RAD]] = x, y, heading
    agent[A.STATION] = round(station) if guess is None else guess
    return located(agent, road)


def where_it_exists(i80: Corridor, lane: int, margin: int = 2) -> np.ndarray:
    """Stations (m) around which the lane exists."""
    exists = ~np.isnan(i80.lane_left[lane])
    inside = exists.copy()
    for shift in range(1, margin + 1):
        inside[shift:] &= exists[:-shift]
        inside[:-shift] &= exists[shift:]
    return np.flatnonzero(inside)


@pytest.mark.parametrize("lane", range(7))
def test_a_vehicle_is_found_where_it_was_placed(i80, road, lane):
    g = np.random.default_rng(lane)
    for station in where_it_exists(i80, lane)[:: 7 if lane < 6 else 1] + g.uniform(-0.5, 0.5):
        wanted, heading = g.uniform(-1.5, 1.5), g.uniform(-0.2, 0.2)
        agent = placed(road, station, lane, wanted, heading)
        assert agent[A.LANE] == lane
        assert station_of(agent, road) == pytest.approx(station, abs=1e-6)
        assert agent[A.LANE_OFFSET_M] == pytest.approx(wanted, abs=1e-3)
        assert agent[A.LANE_HEADING_RAD] == pytest.approx(heading, abs=5e-4)
        assert agent[A.OFF_ROAD] == 0.0


@pytest.mark.parametrize("lane", range(7))
def test_the_markings_are_those_of_the_corridor(i80, road, lane):
    for station in where_it_exists(i80, lane)[::11]:
        agent = placed(road, float(station), lane, 0.4)
        width = float(i80.lane_width(lane, station))
        assert agent[A.LEFT_MARKING_M] == pytest.approx(width / 2 - 0.4, abs=1e-3)
        assert agent[A.RIGHT_MARKING_M] == pytest.approx(width / 2 + 0.4, abs=1e-3)


def test_positions_agree_with_the_corridor_s_own_projection(i80, road):
    g = np.random.default_rng(1)
    for _ in range(400):
        station, offset = g.uniform(5.0, i80.length_m - 5.0), g.uniform(-18.0, 12.0)
        agent = at(road, i80, station, offset)
        s, across = i80.project(agent[A.X_M], agent[A.Y_M])
        assert station_of(agent, road) == pytest.approx(float(s), abs=CENTIMETRE)
        assert agent[A.OFFSET_M] == pytest.approx(float(across), abs=1e-3)


def test_a_vehicle_is_found_from_any_remembered_station(i80, road):
    for guess in (0, 3, 900, 2050):
        agent = at(road, i80, 700.3, -4.0, guess)
        assert station_of(agent, road) == pytest.approx(700.3, abs=CENTIMETRE)


@pytest.mark.parametrize("station", [50.0, 400.5, 900.0, 1100.25, 1500.0, 2000.0])
def test_the_lane_changes_at_the_marking(i80, road, station):
    for lane in range(5):
        # the right one
        marking = 0.5 * float(i80.lane_center(lane, station) * 2 - i80.lane_width(lane, station))
        left, right = (
            at(road, i80, station, marking + CENTIMETRE),
            at(road, i80, station, marking - CENTIMETRE),
        )
        assert (left[A.LANE], right[A.LANE]) == (lane, lane + 1)
        assert left[A.RIGHT_MARKING_M] == pytest.approx(CENTIMETRE, abs=1e-3)
        assert right[A.LEFT_MARKING_M] == pytest.approx(CENTIMETRE, abs=1e-3)


@pytest.mark.parametrize("station", [1.0, 333.0, 837.0, 1000.4, 1266.0, 1270.0, 2049.0])
def test_beyond_the_outermost_markings_is_off_the_road(i80, road, station):
    k = round(station)
    for border, outward in ((i80.road_left[k], 1.0), (i80.road_right[k], -1.0)):
        assert at(road, i80, station, border - outward * 0.02)[A.OFF_ROAD] == 0.0
        assert at(road, i80, station, border + outward * 0.02)[A.OFF_ROAD] == 1.0


def test_the_auxiliary_lane_belongs_to_the_road_only_where_it_is(i80, road):
    there = where_it_exists(i80, 6)
    station = float(there[len(there) // 2])
    offset = float(i80.lane_center(6, station))
    inside = at(road, i80, station, offset)
    assert (inside[A.LANE], inside[A.OFF_ROAD]) == (6.0, 0.0)
    outside = at(road, i80, 300.0, offset)
    assert (outside[A.LANE], outside[A.OFF_ROAD]) == (5.0, 1.0)
    assert outside[A.RIGHT_MARKING_M] < 0.0


def test_before_the_start_is_off_the_road(i80, road):
    assert at(road, i80, 0.0, 0.0)[A.OFF_ROAD] == 0.0
    assert at(road, i80, -0.4, 0.0)[A.OFF_ROAD] == 0.0
    assert at(road, i80, -0.6, 0.0)[A.OFF_ROAD] == 1.0
    assert at(road, i80, -30.0, 0.0)[A.OFF_ROAD] == 1.0


def test_past_the_end_the_station_goes_on(i80, road):
    agent = at(road, i80, i80.length_m + 12.0, -3.0, guess=2050)
    assert agent[A.STATION] == len(road.reference) - 1
    assert station_of(agent, road) == pytest.approx(i80.length_m + 12.0, abs=0.05)
    assert agent[A.LANE] >= 0


def driven_along(i80: Corridor, road: Road, lane: int, step: float) -> np.ndarray:
    """What a vehicle that keeps a constant distance from the reference line perceives, every `step` metres."""
    stations = np.arange(0.0, i80.length_m, step)
    offset = float(i80.lane_center(lane, 0.0)) + 0.3
    x, y, heading = i80.to_xy(stations, offset)
    agent = np.zeros(A.COLUMNS)
    rows = []
    for values in zip(x, y, heading, strict=True):
        agent[[A.X_M, A.Y_M, A.HEADING_RAD]] = values
        rows.append(located(agent, road).copy())
    return np.array(rows)


def test_between_two_stations_of_a_bend_one_of_them_is_chosen(i80, road):
    """On the inside of a bend each of two stations can see the point beyond the middle, towards the other."""
    for k in np.flatnonzero(np.abs(i80.ref_curvature) > 5e-4)[::5]:
        for along in (0.5 - 1e-6, 0.5 - 1e-7, 0.5, 0.5 + 1e-7, 0.5 + 1e-6):
            for guess in (k, k + 1):
                agent = at(road, i80, k + along, -5.0, int(guess))
                assert abs(agent[A.ALONG_M]) < 0.5 + 1e-5
                assert station_of(agent, road) == pytest.approx(k + along, abs=1e-3)
                assert agent[A.LANE_HEADING_RAD] == pytest.approx(0.0, abs=5e-4)


@pytest.mark.parametrize("lane", [0, 2, 4])
def test_nothing_that_a_vehicle_perceives_jumps_on_the_way(i80, road, lane):
    """Not at stations, not at the joints of edges, not at the ends of the auxiliary lane."""
    rows = driven_along(i80, road, lane, 0.1)
    assert (rows[:, A.LANE] == lane).all()
    for column, most in ((A.LANE_OFFSET_M, 2e-3), (A.LEFT_MARKING_M, 2e-3), (A.RIGHT_MARKING_M, 2e-3)):
        assert np.abs(np.diff(rows[:, column])).max() < most
    assert np.abs(np.diff(rows[:, A.LANE_HEADING_RAD])).max() < 5e-4
    assert np.abs(np.diff(rows[:, A.CURVATURE_PER_M])).max() < 2e-4
    progress = np.diff(rows[:, A.STATION] * road.spacing_m + rows[:, A.ALONG_M])
    assert progress == pytest.approx(0.1, abs=2e-3)


def test_the_rightmost_through_lane_is_kept_past_the_auxiliary_lane(i80, road):
    rows = driven_along(i80, road, 5, 0.1)
    assert (rows[:, A.LANE] == 5).all()
    assert np.abs(np.diff(rows[:, A.LANE_OFFSET_M])).max() < 2e-3


def test_where_the_auxiliary_lane_ends_its_vehicle_is_off_the_road(i80, road):
    last = int(where_it_exists(i80, 6, margin=0)[-1])
    offset = float(i80.lane_center(6, last))
    flags = [at(road, i80, last + d, offset)[A.OFF_ROAD] for d in (-3.0, 0.0, 0.4, 0.6, 3.0)]
    assert flags == [0.0, 0.0, 0.0, 1.0, 1.0]


def test_curvature_is_that_of_the_lane_not_of_the_reference_line(i80, road):
    k = int(np.abs(i80.ref_curvature[100:-100]).argmax()) + 100
    curvature = float(i80.ref_curvature[k])
    for offset in (-10.0, 0.0, 6.0):
        agent = at(road, i80, float(k), offset)
        assert 1.0 / agent[A.CURVATURE_PER_M] == pytest.approx(1.0 / curvature - offset, rel=1e-4)


def test_a_vehicle_that_turns_left_has_a_positive_lane_heading(i80, road):
    agent = placed(road, 500.0, 2, 0.0, 0.1)
    assert agent[A.LANE_HEADING_RAD] == pytest.approx(0.1, abs=5e-4)
    before = agent[A.LANE_OFFSET_M]
    agent[A.X_M] += math.cos(agent[A.HEADING_RAD])
    agent[A.Y_M] += math.sin(agent[A.HEADING_RAD])
    assert located(agent, road)[A.LANE_OFFSET_M] > before + 0.09


def test_the_kernels_tables_are_the_corridor_s_to_a_micrometre(i80, road):
    assert np.abs(road.reference[:, REF_X] - i80.ref_x).max() < 1e-6
    assert np.nanmax(np.abs(road.lanes[:, :, 0] - i80.lane_left.T)) < 1e-6
    assert np.array_equal(np.isnan(road.lanes[:, :, 0]), np.isnan(i80.lane_left.T))
    assert road.length_m == i80.length_m


def test_nobody_is_invited_into_the_reserved_lane(i80, road):
    assert i80.reserved[0].all()  # I-80's lane for several occupants
    assert not i80.reserved[1:].any()
    beside, inside, two_beside = (placed(road, 500.0, lane, 0.0, 0.0) for lane in (1, 0, 2))
    assert [beside[A.LANE_TO_THE_LEFT], beside[A.LANE_TO_THE_RIGHT]] == [0.0, 1.0]
    assert [inside[A.LANE_TO_THE_LEFT], inside[A.LANE_TO_THE_RIGHT]] == [0.0, 1.0]
    assert [two_beside[A.LANE_TO_THE_LEFT], two_beside[A.LANE_TO_THE_RIGHT]] == [1.0, 1.0]
    open_road = road_of(load_corridor("us101"))
    assert placed(open_road, 300.0, 1, 0.0, 0.0)[A.LANE_TO_THE_LEFT] == 1.0
