"""The lanes of a road as arrays over its length: what the world's kernels, plots and tests read.

Frame: the network's own x, y in m; stations in m along a smooth reference line from the start of the road;
lateral offsets in m, left positive. Lanes are numbered as NGSIM does: index 0 (lane 1) is leftmost.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from sumo_nets.chain import SMOOTHING_M, Chain, open_net
from sumo_nets.curves import Curve, resample, whittaker
from sumo_nets.errors import EdgesError, NetworkError
from sumo_nets.rules import Rules, rules_of
from sumo_nets.stored import stored_lanes
from sumo_nets.strips import admits

__all__ = ["BUILT_IN", "Corridor", "NetworkError", "built_in_folder", "load_corridor", "read_corridor"]

BUILT_IN = ("i80", "us101")
LANES_FILE = "lanes.npz"  # of a built-in network, beside its net


@dataclass(frozen=True, eq=False)
class Corridor:
    """Lane geometry of one road, K + 1 stations and L lanes; see the module for the frame.

    station_m: (K+1,), exactly `ds_m` apart along the arc.
    ref_x, ref_y, ref_heading (rad from +x, counter-clockwise, continuous), ref_curvature (1/m): (K+1,), the
    reference line.
    lane_left, lane_right: (L, K+1), offsets of each lane's boundaries, NaN where it does not exist.
    road_left, road_right: (K+1,), offsets of the outermost drivable edges.
    edge_index, sumo_lane: (L, K+1) int32, index into `edges` and SUMO's lane index (0 = rightmost, in left-hand
    traffic leftmost), -1 where the lane is absent; inside a junction they are those of the nearer edge.
    reserved: (L, K+1) bool, where a lane exists that ordinary passenger cars may not use (a high-occupancy lane).
    rules: further rules of lanes, where the network has any.
    """

    name: str
    net_path: str
    edges: tuple[str, ...]
    ds_m: float
    length_m: float
    station_m: np.ndarray
    ref_x: np.ndarray
    ref_y: np.ndarray
    ref_heading: np.ndarray
    ref_curvature: np.ndarray
    lane_left: np.ndarray
    lane_right: np.ndarray
    road_left: np.ndarray
    road_right: np.ndarray
    edge_index: np.ndarray
    sumo_lane: np.ndarray
    reserved: np.ndarray
    rules: Rules | None = None

    @property
    def lane_count(self) -> int:
        """L: lanes of the widest numbering, auxiliary lanes included."""
        return len(self.lane_left)

    @cached_property
    def reference(self) -> Curve:
        """The reference line as a curve."""
        return Curve(self.ds_m, self.ref_x, self.ref_y, self.ref_heading, self.ref_curvature)

    def nearest_station(self, station: ArrayLike) -> np.ndarray:
        """Index k of the station nearest to `station` (m), kept within the road."""
        return np.clip(np.rint(np.asarray(station) / self.ds_m).astype(np.int64), 0, len(self.station_m) - 1)

    def to_xy(self, station: ArrayLike, offset: ArrayLike) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """x, y (m) and the road's heading (rad) at `station` and lateral `offset` (m)."""
        return self.reference.to_xy(station, offset)

    def project(self, x: ArrayLike, y: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
        """Station and lateral offset (m) of the points x, y; below 0 or above `length_m` beyond the ends."""
        return self.reference.project(x, y)

    def lane_center(self, lane: ArrayLike, station: ArrayLike) -> np.ndarray:
        """Lateral offset (m) of the centre of `lane` (index) at `station` (m); NaN where it is absent."""
        return self._along((self.lane_left + self.lane_right) / 2.0, lane, station)

    def lane_width(self, lane: ArrayLike, station: ArrayLike) -> np.ndarray:
        """Width (m) of `lane` (index) at `station` (m); NaN where the lane is absent."""
        return self._along(self.lane_left - self.lane_right, lane, station)

    def lane_at(self, station: ArrayLike, offset: ArrayLike) -> np.ndarray:
        """Index of the lane that holds the lateral `offset` at `station` (m), -1 off the road."""
        station, offset = np.broadcast_arrays(np.asarray(station, float), np.asarray(offset, float))
        k = self.nearest_station(station)
        inside = (offset <= self.lane_left[:, k]) & (offset >= self.lane_right[:, k])
        return np.where(inside.any(axis=0), inside.argmax(axis=0), -1)

    def lanes_at(self, station: ArrayLike) -> np.ndarray:
        """Number of lanes at `station` (m)."""
        return (self.sumo_lane[:, self.nearest_station(station)] >= 0).sum(axis=0)

    def sumo_position(self, lane: int, station: float) -> tuple[str, int]:
        """SUMO edge and lane index of `lane` at `station` (m); NetworkError where the lane is absent."""
        k = self.nearest_station(station)
        if not 0 <= lane < self.lane_count or self.sumo_lane[lane, k] < 0:
            raise NetworkError(f"{self.name} has no lane {lane + 1} at station {station:.1f} m")
        return self.edges[self.edge_index[lane, k]], int(self.sumo_lane[lane, k])

    def _along(self, values: np.ndarray, lane: ArrayLike, station: ArrayLike) -> np.ndarray:
        lane, station = np.broadcast_arrays(np.asarray(lane, np.int64), np.asarray(station, float))
        at = np.clip(station / self.ds_m, 0.0, len(self.station_m) - 1)
        low = np.minimum(at.astype(np.int64), len(self.station_m) - 2)
        part = at - low
        a, b = values[lane, low], values[lane, low + 1]
        between = (1.0 - part) * a + part * b
        return np.where(part == 0.0, a, np.where(part == 1.0, b, between))


def built_in_folder(name: str) -> Path:
    """Folder with the sources and the built net of a built-in network."""
    if name not in BUILT_IN:
        raise NetworkError(f"no built-in network {name!r}; there are: {', '.join(BUILT_IN)}")
    return Path(__file__).parent / name


def load_corridor(name_or_path: str | Path, edges: Sequence[str] | None = None) -> Corridor:
    """The corridor of a built-in network ("i80") or of a user's `.net.xml` and its edges in order."""
    if str(name_or_path) in BUILT_IN:
        name = str(name_or_path)
        folder = built_in_folder(name)
        net = folder / f"{name}.net.xml"
        kept = None if edges else stored_lanes(folder / LANES_FILE, net)
        if kept is not None:
            return Corridor(net_path=str(net), **(kept | {"edges": tuple(kept["edges"])}))
        description = json.loads((folder / "corridor.json").read_text(encoding="utf-8"))
        return read_corridor(net, tuple(edges or description["edges"]), name=name)
    if not edges:
        kind = EdgesError if Path(name_or_path).suffix in (".xml", ".gz") else NetworkError
        raise kind(
            f"{name_or_path}: name the edges of the corridor in driving order, as in edges=['e1', 'e2'] "
            f"(built-in networks need none: {', '.join(BUILT_IN)})"
        )
    return read_corridor(Path(name_or_path), tuple(edges))


def read_corridor(path: str | Path, edges: Sequence[str], name: str | None = None) -> Corridor:
    """Read the lanes of consecutive `edges` of the SUMO network `path`; NetworkError if that cannot be done.

    The reference line is the middle of the lanes that run through all edges (the longest-running lane if none
    does). Its polyline, junctions included, is smoothed; lanes keep the lateral distances they have from it.
    """
    path = Path(path)
    chain = Chain(open_net(path), path, tuple(edges))
    curve, drawn = chain.reference()
    stations = np.arange(len(curve.x)) * curve.step_m
    swing = _swing(curve, drawn, stations)
    shape = (chain.columns, len(stations))
    left, right = np.full(shape, np.nan), np.full(shape, np.nan)
    edge_index, sumo_lane = np.full(shape, -1, np.int32), np.full(shape, -1, np.int32)
    reserved = np.zeros(shape, bool)
    for column in range(chain.columns):
        for run in chain.runs(column):
            points, widths, owner = chain.polyline(run, column)
            s, offset = curve.project(*points.T)
            order = np.argsort(s, kind="stable")
            s, offset, widths, owner = s[order], offset[order], widths[order], owner[order]
            begin, end = 0, len(stations) - 1  # a lane of the first or last edge reaches the end of the road
            if run[0] > 0:
                begin = int(np.ceil(s[0] / curve.step_m - 1e-6))
            if run[1] < len(chain.edges) - 1:
                end = min(end, int(np.floor(s[-1] / curve.step_m + 1e-6)))
            k = np.arange(begin, end + 1)
            centre = np.interp(stations[k], s, offset) - swing[k]
            half = np.interp(stations[k], s, widths) / 2.0
            left[column, k] = whittaker(centre + half, SMOOTHING_M / curve.step_m, order=2)
            right[column, k] = whittaker(centre - half, SMOOTHING_M / curve.step_m, order=2)
            edge_index[column, k] = owner[np.clip(np.searchsorted(s, stations[k]), 0, len(s) - 1)]
    for i, lanes in enumerate(chain.lanes):
        for position, lane in enumerate(lanes):
            column = chain.first[i] + position
            sumo_lane[column, edge_index[column] == i] = lane.getIndex()
            reserved[column, edge_index[column] == i] = not admits(lane, "passenger")
    rules = rules_of(chain, path, edge_index)
    absent = np.flatnonzero((sumo_lane < 0).all(axis=0))
    if len(absent):
        raise NetworkError(f"{path}: no lane at station {stations[absent[0]]:.0f} m of the corridor")
    return Corridor(
        name=name or path.name.removesuffix(".gz").removesuffix(".net.xml"),
        net_path=str(path),
        edges=chain.edges,
        ds_m=curve.step_m,
        length_m=curve.length_m,
        station_m=stations,
        ref_x=curve.x,
        ref_y=curve.y,
        ref_heading=curve.heading,
        ref_curvature=curve.curvature,
        lane_left=left,
        lane_right=right,
        road_left=np.nanmax(left, axis=0),
        road_right=np.nanmin(right, axis=0),
        edge_index=edge_index,
        sumo_lane=sumo_lane,
        reserved=reserved,
        rules=rules,
    )


def _swing(curve: Curve, drawn: np.ndarray, stations: np.ndarray) -> np.ndarray:
    """How far (m) the drawn line swings about the smooth one at each station; all lanes swing alike."""
    s, offset = curve.project(*resample(drawn, 1.0).T)
    order = np.argsort(s, kind="stable")
    offset = np.interp(stations, s[order], offset[order])
    return offset - whittaker(offset, SMOOTHING_M / curve.step_m, order=2)
