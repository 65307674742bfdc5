"""The lanes of a road as arrays over its length: what the world's kernels, plots and tests read.

Frame: the network's own x, y in m; stations in m along a smooth reference line from the start of the road;
lateral offsets in m, positive to the left of it. Lanes are numbered as in NGSIM: index 0 (lane 1) is leftmost.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from sumo_nets.curves import Curve, drop_repeats, even_curve, resample, smooth_curve, whittaker
from sumo_nets.errors import NetworkError

__all__ = ["BUILT_IN", "Corridor", "NetworkError", "built_in_folder", "load_corridor", "read_corridor"]

BUILT_IN = ("i80",)
STATION_STEP_M = 1.0
SMOOTHING_M = 40.0  # undulations of a lane's polyline shorter than this are drawing, not road


@dataclass(frozen=True, eq=False)
class Corridor:
    """Lane geometry of one road, K + 1 stations and L lanes; see the module for the frame.

    station_m: (K+1,), exactly `ds_m` apart along the arc.
    ref_x, ref_y, ref_heading (rad from +x, counter-clockwise, continuous), ref_curvature (1/m): (K+1,), the
    reference line.
    lane_left, lane_right: (L, K+1), offsets of each lane's boundaries, NaN where it does not exist.
    road_left, road_right: (K+1,), offsets of the outermost drivable edges.
    edge_index, sumo_lane: (L, K+1) int32, index into `edges` and SUMO's lane index (0 = rightmost), -1 where
    the lane is absent; inside a junction they are those of the nearer edge.
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

    @property
    def lane_count(self) -> int:
        """L: lanes of the widest numbering, auxiliary lanes included."""
        return len(self.lane_left)

    @cached_property
    def reference(self) -> Curve:
        """The reference line as a curve."""
        return Curve(self.ds_m, self.ref_x, self.ref_y, self.ref_heading, self.ref_curvature)

    def nearest_station(self, station: np.ndarray) -> np.ndarray:
        """Index k of the station nearest to `station` (m), kept within the road."""
        return np.clip(np.rint(np.asarray(station) / self.ds_m).astype(np.int64), 0, len(self.station_m) - 1)

    def to_xy(self, station: np.ndarray, offset: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """x, y (m) and the road's heading (rad) at `station` and lateral `offset` (m)."""
        return self.reference.to_xy(station, offset)

    def project(self, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Station and lateral offset (m) of the points x, y; below 0 or above `length_m` beyond the ends."""
        return self.reference.project(x, y)

    def lane_center(self, lane: np.ndarray, station: np.ndarray) -> np.ndarray:
        """Lateral offset (m) of the centre of `lane` (index) at `station` (m); NaN where it is absent."""
        return self._along((self.lane_left + self.lane_right) / 2.0, lane, station)

    def lane_width(self, lane: np.ndarray, station: np.ndarray) -> np.ndarray:
        """Width (m) of `lane` (index) at `station` (m); NaN where the lane is absent."""
        return self._along(self.lane_left - self.lane_right, lane, station)

    def lane_at(self, station: np.ndarray, offset: np.ndarray) -> np.ndarray:
        """Index of the lane that holds the lateral `offset` at `station` (m), -1 off the road."""
        station, offset = np.broadcast_arrays(np.asarray(station, float), np.asarray(offset, float))
        k = self.nearest_station(station)
        inside = (offset <= self.lane_left[:, k]) & (offset >= self.lane_right[:, k])
        return np.where(inside.any(axis=0), inside.argmax(axis=0), -1)

    def lanes_at(self, station: np.ndarray) -> np.ndarray:
        """Number of lanes at `station` (m)."""
        return (self.sumo_lane[:, self.nearest_station(station)] >= 0).sum(axis=0)

    def sumo_position(self, lane: int, station: float) -> tuple[str, int]:
        """SUMO edge and lane index of `lane` at `station` (m); NetworkError where the lane is absent."""
        k = self.nearest_station(station)
        if not 0 <= lane < self.lane_count or self.sumo_lane[lane, k] < 0:
            raise NetworkError(f"{self.name} has no lane {lane + 1} at station {station:.1f} m")
        return self.edges[self.edge_index[lane, k]], int(self.sumo_lane[lane, k])

    def _along(self, values: np.ndarray, lane: np.ndarray, station: np.ndarray) -> np.ndarray:
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
        description = json.loads((folder / "corridor.json").read_text(encoding="utf-8"))
        return read_corridor(folder / f"{name}.net.xml", tuple(edges or description["edges"]), name=name)
    if not edges:
        raise NetworkError(
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
    net = _open(path)
    chain = _Chain(net, path, tuple(edges))
    return chain.corridor(name or path.name.removesuffix(".gz").removesuffix(".net.xml"))


def _open(path: Path):
    if not path.is_file():
        raise NetworkError(f"there is no network file {path}; give a SUMO .net.xml or {', '.join(BUILT_IN)}")
    import sumolib  # here because it takes longer to import than the rest of this module together

    try:
        return sumolib.net.readNet(str(path), withInternal=True, withPrograms=False)
    except Exception as error:  # sumolib lets through whatever the XML parser or its own lookups raise
        raise NetworkError(f"{path} is not a SUMO network that can be read: {error}") from error


class _Chain:
    """Edges in driving order with one lane numbering: column c of every edge is the same strip of road."""

    def __init__(self, net, path: Path, edges: tuple[str, ...]):
        self.path, self.edges = path, edges
        self.parts = []
        for edge in edges:
            if not net.hasEdge(edge):
                known = [e.getID() for e in net.getEdges(withInternal=False)]
                shown = ", ".join(known[:8]) + (", ..." if len(known) > 8 else "")
                raise NetworkError(f"{path}: no edge {edge!r}; the network has {len(known)} edges: {shown}")
            self.parts.append(net.getEdge(edge))
        # lanes from the left: position 0 is SUMO's highest index
        self.lanes = [list(reversed(part.getLanes())) for part in self.parts]
        self.links = [self._link(net, i) for i in range(len(edges) - 1)]
        shift = np.cumsum([0] + [self._shift(link) for link in self.links])
        self.first = [int(s) for s in shift - shift.min()]  # column of the leftmost lane of each edge
        self.columns = max(f + len(lanes) for f, lanes in zip(self.first, self.lanes, strict=True))

    def _link(self, net, i: int) -> dict[tuple[int, int], np.ndarray]:
        """Connections from edge i to edge i + 1: (position, position) -> points inside the junction."""
        found = {}
        position = [{lane.getID(): p for p, lane in enumerate(self.lanes[j])} for j in (i, i + 1)]
        for connection in self.parts[i].getOutgoing().get(self.parts[i + 1], []):
            key = (position[0][connection.getFromLane().getID()], position[1][connection.getToLane().getID()])
            found[key] = self._inside(net, connection.getViaLaneID())
        if not found:
            a, b = self.edges[i], self.edges[i + 1]
            followers = ", ".join(e.getID() for e in self.parts[i].getOutgoing()) or "nothing"
            raise NetworkError(f"{self.path}: edge {a!r} does not lead to {b!r}; it leads to {followers}")
        return found

    def _inside(self, net, via: str) -> np.ndarray:
        shapes = []
        while via:
            lane = net.getLane(via)
            shapes.append(np.array(lane.getShape(), float)[:, :2])
            onward = lane.getOutgoing()
            via = onward[0].getViaLaneID() if onward else ""
        return np.concatenate(shapes) if shapes else np.empty((0, 2))

    @staticmethod
    def _shift(link) -> int:
        """Columns by which edge i + 1 begins to the right (+) of edge i: the connections' vote."""
        shifts = [a - b for a, b in link]
        return max(sorted(set(shifts), key=abs), key=shifts.count)

    def has(self, i: int, column: int) -> bool:
        return 0 <= column - self.first[i] < len(self.lanes[i])

    def runs(self, column: int) -> list[tuple[int, int]]:
        """Stretches (first edge, last edge) over which the column goes on without a break."""
        out: list[tuple[int, int]] = []
        for i in range(len(self.edges)):
            if not self.has(i, column):
                continue
            joined = out and out[-1][1] == i - 1 and self._joint(i - 1, column) is not None
            out = [*out[:-1], (out[-1][0], i)] if joined else [*out, (i, i)]
        return out

    def _joint(self, i: int, column: int) -> np.ndarray | None:
        return self.links[i].get((column - self.first[i], column - self.first[i + 1]))

    def lane(self, i: int, column: int):
        return self.lanes[i][column - self.first[i]]

    def polyline(self, run: tuple[int, int], column: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Centre points (n, 2) of a run, the lane's width at each and the edge each belongs to."""
        points, widths, owner = [], [], []
        for i in range(run[0], run[1] + 1):
            lane = self.lane(i, column)
            shape = resample(np.array(lane.getShape(), float)[:, :2], 1.0)
            points.append(shape)
            widths.append(np.full(len(shape), lane.getWidth()))
            owner.append(np.full(len(shape), i))
            joint = self._joint(i, column) if i < run[1] else None
            if joint is not None and len(joint):
                after = self.lane(i + 1, column).getWidth()
                points.append(joint)
                widths.append(np.linspace(lane.getWidth(), after, len(joint)))
                owner.append(np.where(np.arange(len(joint)) < len(joint) / 2, i, i + 1))
        return np.concatenate(points), np.concatenate(widths), np.concatenate(owner)

    def reference(self) -> tuple[Curve, np.ndarray]:
        """Smooth line in the middle of the through lanes, and the polyline (n, 2) it was made from."""
        present = [sum(self.has(i, c) for i in range(len(self.edges))) for c in range(self.columns)]
        through = [c for c in range(self.columns) if self.runs(c) == [(0, len(self.edges) - 1)]]
        if not through:
            through = [int(np.argmax(present))]
        low, high = through[(len(through) - 1) // 2], through[len(through) // 2]
        raw = self._spine(low)
        curve = smooth_curve(raw, SMOOTHING_M, STATION_STEP_M)
        if high != low:
            width = 0.5 * (self.lane(0, low).getWidth() + self.lane(0, high).getWidth())
            curve = even_curve(curve.shifted(-width / 2.0), STATION_STEP_M)
        return curve, raw

    def _spine(self, column: int) -> np.ndarray:
        """Polyline of a column over all edges; where it is missing, that of the nearest lane moved over."""
        points = []
        for i in range(len(self.edges)):
            position = int(np.clip(column - self.first[i], 0, len(self.lanes[i]) - 1))
            lane = self.lanes[i][position]
            shape = np.array(lane.getShape(), float)[:, :2]
            aside = (position - (column - self.first[i])) * lane.getWidth()
            if aside:
                tangent = np.gradient(shape, axis=0)
                tangent /= np.hypot(*tangent.T)[:, None]
                shape = shape + aside * np.column_stack([-tangent[:, 1], tangent[:, 0]])
            points.append(shape)
            joint = self._joint(i, column) if i + 1 < len(self.edges) and self.has(i, column) else None
            if joint is not None:
                points.append(joint)
        return drop_repeats(np.concatenate(points))

    def corridor(self, name: str) -> Corridor:
        curve, raw = self.reference()
        stations = np.arange(len(curve.x)) * curve.step_m
        shape = (self.columns, len(stations))
        left, right = np.full(shape, np.nan), np.full(shape, np.nan)
        edge_index, sumo_lane = np.full(shape, -1, np.int32), np.full(shape, -1, np.int32)
        # how far the drawn line swings about the smooth one; taken out of all lanes alike
        swing_s, swing = curve.project(*resample(raw, 1.0).T)
        order = np.argsort(swing_s, kind="stable")
        swing = np.interp(stations, swing_s[order], swing[order])
        swing -= whittaker(swing, SMOOTHING_M, order=2) if np.ptp(swing) > 0 else swing
        for column in range(self.columns):
            for run in self.runs(column):
                points, widths, owner = self.polyline(run, column)
                s, offset = curve.project(*points.T)
                order = np.argsort(s, kind="stable")
                s, offset, widths, owner = s[order], offset[order], widths[order], owner[order]
                begin = 0 if run[0] == 0 else int(np.ceil(s[0] / curve.step_m - 1e-6))
                end = len(stations) - 1
                if run[1] < len(self.edges) - 1:
                    end = min(end, int(np.floor(s[-1] / curve.step_m + 1e-6)))
                if end < begin:
                    continue
                k = np.arange(begin, end + 1)
                centre = np.interp(stations[k], s, offset) - swing[k]
                half = np.interp(stations[k], s, widths) / 2.0
                left[column, k] = whittaker(centre + half, SMOOTHING_M / curve.step_m, order=2)
                right[column, k] = whittaker(centre - half, SMOOTHING_M / curve.step_m, order=2)
                nearest = np.clip(np.searchsorted(s, stations[k]), 0, len(s) - 1)
                edge_index[column, k] = owner[nearest]
        for i, lanes in enumerate(self.lanes):
            for position, lane in enumerate(lanes):
                column = self.first[i] + position
                sumo_lane[column, edge_index[column] == i] = lane.getIndex()
        absent = np.flatnonzero((sumo_lane < 0).all(axis=0))
        if len(absent):
            raise NetworkError(f"{self.path}: no lane at station {stations[absent[0]]:.0f} m of the corridor")
        return Corridor(
            name=name,
            net_path=str(self.path),
            edges=self.edges,
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
        )
