"""The road surface: asphalt, shoulders, wear and markings, from the corridor's lanes and the network's other lanes."""

import numpy as np

from service.world.camera.ground import (
    ASPHALT,
    LANES,
    PATCH,
    ROAD,
    SHOULDER,
    TAR,
    TRACK,
    WEAR,
    WHITE,
    YELLOW,
    GroundBuilder,
)  # fmt: skip
from sumo_nets.corridor import Corridor
from sumo_nets.lanes import LaneShape

STEP_M = 15.0  # length of a piece of a strip: on a radius of 850 m its chord is 3 cm off
DASH_CYCLE_M = 14.63  # California: 12 ft painted, 36 ft free
DASH_SHARE = 0.25
SHORT_CYCLE_M = 4.57  # beside acceleration and deceleration lanes: 3 ft painted, 12 ft free
SHORT_SHARE = 0.2
LINE_M = 0.15
WIDE_LINE_M = 0.20
SHOULDER_LEFT_M = 2.2
SHOULDER_RIGHT_M = 2.8
SEALED_BEYOND_M = 300.0  # the road goes on for the eye beyond the corridor's ends


def stations(
    corridor: Corridor, step_m: float, begin_m: float = 0.0, end_m: float | None = None
) -> np.ndarray:
    """Stations from begin to end, about `step_m` apart, both ends included."""
    end = corridor.length_m if end_m is None else end_m
    return np.linspace(begin_m, end, max(2, int(np.ceil((end - begin_m) / step_m)) + 1))


def points(corridor: Corridor, at: np.ndarray, offset: np.ndarray | float) -> np.ndarray:
    """x, y (n, 2) at stations and lateral offsets; beyond the ends the road goes straight on."""
    inside = np.clip(at, 0.0, corridor.length_m)
    x, y, heading = corridor.to_xy(inside, offset)
    beyond = at - inside
    return np.column_stack([x + beyond * np.cos(heading), y + beyond * np.sin(heading)])


def edge_offsets(corridor: Corridor, at: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Offsets (n,) of the outermost left and right lane boundaries."""
    inside = np.clip(at, 0.0, corridor.length_m)
    return (
        np.interp(inside, corridor.station_m, corridor.road_left),
        np.interp(inside, corridor.station_m, corridor.road_right),
    )


def pave(corridor: Corridor, hov_lanes: set[int], b: GroundBuilder) -> None:
    """The corridor's own surface and markings; hov_lanes: indices of lanes for several occupants, 0 the leftmost."""
    at = stations(corridor, STEP_M, -SEALED_BEYOND_M, corridor.length_m + SEALED_BEYOND_M)
    left, right = edge_offsets(corridor, at)
    b.strip(points(corridor, at, left + SHOULDER_LEFT_M), points(corridor, at, left), ROAD, SHOULDER)
    b.strip(points(corridor, at, right), points(corridor, at, right - SHOULDER_RIGHT_M), ROAD, SHOULDER)
    b.strip(points(corridor, at, left), points(corridor, at, right), LANES, ASPHALT)
    _wear(corridor, at, b)
    _edge_lines(corridor, b)
    for lane in range(corridor.lane_count - 1):
        _lane_line(corridor, lane, hov_lanes, b)


def _held(corridor: Corridor, values: np.ndarray, at: np.ndarray) -> np.ndarray:
    """Values over the stations (K+1,) at stations `at`, NaN where the lane is absent."""
    inside = np.clip(at, 0.0, corridor.length_m)
    found = np.interp(inside, corridor.station_m, np.nan_to_num(values))
    here = np.isfinite(values[corridor.nearest_station(inside)])
    return np.where(here, found, np.nan)


def _wear(corridor: Corridor, at: np.ndarray, b: GroundBuilder) -> None:
    """Wheel tracks in every lane, patches and sealed cracks at places that do not change."""
    rng = np.random.default_rng(8)
    for lane in range(corridor.lane_count):
        along = at[::2]
        middle = _held(corridor, 0.5 * (corridor.lane_left[lane] + corridor.lane_right[lane]), along)
        for side in (-0.85, 0.85):
            centre = middle + side
            b.strip(
                points(corridor, along, centre + 0.32), points(corridor, along, centre - 0.32), WEAR, TRACK
            )
        for _ in range(int(corridor.length_m / 90.0)):
            begin = rng.uniform(0.0, corridor.length_m - 40.0)
            ends = np.linspace(begin, begin + rng.uniform(3.0, 28.0), 4)
            low, high = np.sort(rng.uniform(-1.7, 1.7, 2))
            here = _held(corridor, 0.5 * (corridor.lane_left[lane] + corridor.lane_right[lane]), ends)
            b.strip(points(corridor, ends, here + high), points(corridor, ends, here + low), WEAR, PATCH)
        for _ in range(int(corridor.length_m / 45.0)):
            begin = rng.uniform(0.0, corridor.length_m - 20.0)
            ends = begin + np.linspace(0.0, rng.uniform(2.0, 14.0), 5)
            here = _held(corridor, 0.5 * (corridor.lane_left[lane] + corridor.lane_right[lane]), ends)
            b.line(
                points(corridor, ends, here + rng.uniform(-1.6, 1.6) + rng.normal(0.0, 0.12, 5)), 0.06, TAR
            )


def _edge_lines(corridor: Corridor, b: GroundBuilder) -> None:
    at = stations(corridor, STEP_M, -SEALED_BEYOND_M, corridor.length_m + SEALED_BEYOND_M)
    left, right = edge_offsets(corridor, at)
    b.line(points(corridor, at, left - 0.2), LINE_M, YELLOW)
    b.line(points(corridor, at, right + 0.2), LINE_M, WHITE)


def _lane_line(corridor: Corridor, lane: int, hov_lanes: set[int], b: GroundBuilder) -> None:
    """The line between `lane` and the next one to its right."""
    border = np.where(np.isfinite(corridor.lane_left[lane + 1]), corridor.lane_right[lane], np.nan)
    if lane in hov_lanes and lane + 1 not in hov_lanes:  # two solid lines
        at = stations(corridor, STEP_M)
        offset = _held(corridor, border, at)
        for side in (-0.16, 0.16):
            b.line(points(corridor, at, offset + side), 0.12, WHITE)
        _diamonds(corridor, lane, b)
        return
    share_of_road = np.isfinite(border).mean()
    cycle, share, width = (DASH_CYCLE_M, DASH_SHARE, LINE_M)
    if share_of_road < 0.6:
        cycle, share, width = SHORT_CYCLE_M, SHORT_SHARE, WIDE_LINE_M
    at = np.arange(0.0, corridor.length_m, cycle)
    b.line(points(corridor, at, _held(corridor, border, at)), width, WHITE, share)


def _diamonds(corridor: Corridor, lane: int, b: GroundBuilder) -> None:
    """The HOV lane's diamonds, 3.7 m long."""
    middle = 0.5 * (corridor.lane_left[lane] + corridor.lane_right[lane])
    for station in np.arange(60.0, corridor.length_m - 10.0, 150.0):
        ends = station + np.array([0.0, 1.85, 3.7])
        centre = _held(corridor, middle, ends)
        for side in (-1.0, 1.0):
            b.line(points(corridor, ends, centre + side * np.array([0.0, 0.42, 0.0])), 0.18, WHITE)


def pave_lane(lane: LaneShape, b: GroundBuilder) -> None:
    """A lane that is not the corridor's: asphalt, and lines along its sides."""
    line = lane.points
    step = np.diff(line, axis=0)
    length = np.maximum(np.hypot(*step.T), 1e-6)
    tangent = np.vstack([step / length[:, None], step[-1:] / length[-1]])
    tangent[1:-1] = 0.5 * (tangent[:-2] + tangent[1:-1])
    tangent /= np.maximum(np.hypot(*tangent.T), 1e-6)[:, None]
    normal = np.column_stack([-tangent[:, 1], tangent[:, 0]])
    half = 0.5 * lane.width_m
    b.strip(line + (half + 0.8) * normal, line - (half + 0.8) * normal, ROAD, SHOULDER)
    b.strip(line + half * normal, line - half * normal, ROAD, ASPHALT)
    if not lane.internal:
        for side, paint in ((half - 0.15, WHITE), (0.15 - half, WHITE)):
            b.line(line + side * normal, LINE_M, paint)
