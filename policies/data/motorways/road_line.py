"""The road that tracks in the plane were driven on: a line along it, and where its lanes lie.

The line begins as the longest track. Tracks that change lanes are in the minority, so at each station the median slope
of all tracks against the line is what the line itself is wrong by; it is turned by that, twice. Then lanes are parallel
to it: the peaks of the distribution of lateral positions, at least NARROWEST_M apart.
"""

from dataclasses import dataclass

import numpy as np
import polars as pl
from scipy.ndimage import gaussian_filter1d
from scipy.signal import find_peaks

from policies.data.scenes import DataError, Samples, project, smooth_curve

CELL_M = 10.0
TURNS = 2  # how often the line is turned to the tracks
TRACKS = 5  # a cell with fewer says nothing
BIN_M = 0.1
SPREAD_M = 0.3  # by which the distribution of lateral positions is smoothed before its peaks are sought
NARROWEST_M = 2.5
LEAST_SHARE = 0.05  # of the highest peak: a lower one is no lane
BESIDE = 0.75  # lane spacings from the nearest centre: further out a vehicle is in no lane
LANE_M = 3.7  # where there is one lane only


@dataclass(frozen=True)
class RoadLine:
    """A line along a road in the direction of travel, and its lanes.

    curve: x, y (m), heading (rad) and curvature (1/m) every metre
    station_m: (n,) along it
    lanes_m: (L,) the lanes' centres to the left of the line, leftmost first
    """

    curve: Samples
    station_m: np.ndarray
    lanes_m: np.ndarray

    @property
    def lane_width_m(self) -> float:
        """The mean distance between the centres of neighbouring lanes."""
        if len(self.lanes_m) < 2:
            return LANE_M
        return float(self.lanes_m[0] - self.lanes_m[-1]) / (len(self.lanes_m) - 1)

    def lane_of(self, left_m: np.ndarray) -> np.ndarray:
        """The lane (n,), 1 = leftmost, of positions to the left of the line; 0 where they are in none."""
        apart = np.abs(left_m[:, None] - self.lanes_m)
        nearest = apart.argmin(axis=1)
        return np.where(apart.min(axis=1) <= BESIDE * self.lane_width_m, nearest + 1, 0)


def road_line(rows: pl.DataFrame) -> tuple[RoadLine, np.ndarray, np.ndarray]:
    """The line of rows (vehicle_id, frame, x_m, y_m; sorted so), and the rows' stations and positions to its left.

    Raises DataError where the tracks are too short to tell a road.
    """
    points = rows.select("x_m", "y_m").to_numpy()
    vehicle = rows["vehicle_id"].to_numpy()
    starts = np.flatnonzero(np.r_[True, vehicle[1:] != vehicle[:-1]])
    ends = np.r_[starts[1:], len(vehicle)]
    reach = np.hypot(*(points[ends - 1] - points[starts]).T)
    longest = int(reach.argmax())
    if reach[longest] < 5.0 * CELL_M:
        raise DataError(f"no track is longer than {reach[longest]:.0f} m; a road is told by longer ones")
    curve, station = smooth_curve(points[starts[longest] : ends[longest]])
    s, left = project(points, curve)
    curve, station = smooth_curve(_extended(curve, station, points, s, left, vehicle))
    s, left = project(points, curve)
    for _ in range(TURNS):
        x, y, heading, _ = curve
        off = _offset(station, s, left, vehicle)
        curve, station = smooth_curve(np.column_stack([x - off * np.sin(heading), y + off * np.cos(heading)]))
        s, left = project(points, curve)
    return RoadLine(curve, station, _lanes(s, left, vehicle)), s, left


def _extended(
    curve: Samples,
    station: np.ndarray,
    points: np.ndarray,
    s: np.ndarray,
    left: np.ndarray,
    vehicle: np.ndarray,
) -> np.ndarray:
    """The line's points (n, 2), and before and after them those of the tracks that reach furthest, moved onto it."""
    x, y, heading, _ = curve
    parts = [np.column_stack([x, y])]
    for end, furthest, beyond in ((0, int(s.argmin()), s < 0.0), (-1, int(s.argmax()), s > station[-1])):
        track = (vehicle == vehicle[furthest]) & beyond
        joint = int(np.flatnonzero(track)[-1 if end == 0 else 0]) if track.any() else furthest
        across = left[joint] * np.array([-np.sin(heading[end]), np.cos(heading[end])])
        more = points[track][np.abs(s[track] - station[end]) > 1.0] - across
        parts = [more, *parts] if end == 0 else [*parts, more]
    return np.concatenate(parts)


def _offset(station: np.ndarray, s: np.ndarray, left: np.ndarray, vehicle: np.ndarray) -> np.ndarray:
    """How far to the left of the line, at its stations, a line runs that is parallel to most tracks."""
    forward = np.diff(s)
    use = (vehicle[1:] == vehicle[:-1]) & (forward > 0.1)
    slopes = pl.DataFrame(
        {
            "cell": (s[1:] // CELL_M).astype(np.int64)[use],
            "vehicle": vehicle[1:][use],
            "slope": (np.diff(left)[use] / forward[use]),
        }
    )
    cells = (
        slopes.group_by("cell", "vehicle")
        .agg(pl.col("slope").median())
        .group_by("cell")
        .agg(pl.col("slope").median(), pl.len().alias("tracks"))
        .filter(pl.col("tracks") >= TRACKS)
        .sort("cell")
    )
    if not cells.height:
        return np.zeros(len(station))
    slope = np.interp(station, (cells["cell"].to_numpy() + 0.5) * CELL_M, cells["slope"].to_numpy())
    return np.cumsum(slope) * (station[1] - station[0])


def _lanes(s: np.ndarray, left: np.ndarray, vehicle: np.ndarray) -> np.ndarray:
    """The lanes' centres, leftmost first: each vehicle counts once a cell."""
    once = pl.DataFrame({"cell": (s // CELL_M).astype(np.int64), "vehicle": vehicle, "left": left})
    at = once.group_by("cell", "vehicle").agg(pl.col("left").median())["left"].to_numpy()
    low, high = np.quantile(at, (0.002, 0.998))
    edges = np.arange(low - 2.0, high + 2.0 + BIN_M, BIN_M)
    density = gaussian_filter1d(np.histogram(at, edges)[0].astype(float), SPREAD_M / BIN_M)
    peaks, _ = find_peaks(
        density, height=LEAST_SHARE * density.max(), distance=max(1, round(NARROWEST_M / BIN_M))
    )
    return (edges[peaks] + 0.5 * BIN_M)[::-1]
