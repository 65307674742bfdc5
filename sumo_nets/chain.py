"""Consecutive SUMO edges with one lane numbering, the stretches of their lanes and their middle line."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from sumo_nets.curves import Curve, drop_repeats, even_curve, resample, smooth_curve
from sumo_nets.errors import EdgesError, NetworkError
from sumo_nets.readable import check_kind
from sumo_nets.strips import points_of, strips

STATION_STEP_M = 1.0
SMOOTHING_M = 40.0  # undulations of a lane's polyline shorter than this are drawing, not road


def open_net(path: Path) -> Any:  # a sumolib.net.Net: sumolib comes without types
    """The network file as sumolib's object; NetworkError if it is missing or is not one."""
    if not path.is_file():
        raise NetworkError(f"there is no network file {path}; give a SUMO .net.xml or a built-in name")
    check_kind(path)
    import sumolib  # here because it takes longer to import than the rest of this module together

    try:
        return sumolib.net.readNet(str(path), withInternal=True, withPrograms=False)
    except Exception as error:  # sumolib lets through whatever the XML parser or its own lookups raise
        raise NetworkError(
            f"{path} is not a SUMO network that can be read ({type(error).__name__}: {error}); build it anew with "
            "netconvert"
        ) from error


class Chain:
    """Edges in driving order with one lane numbering: column c of every edge is the same strip of road.

    `lanes[i]` are the lanes of edge i from the left (`sumo_nets.strips`), `first[i]` is the column of the leftmost of
    them.
    """

    def __init__(self, net: Any, path: Path, edges: tuple[str, ...]):
        if not edges:
            raise EdgesError(f"{path}: a corridor needs at least one edge")
        self.path, self.edges = path, edges
        self.parts = []
        for edge in edges:
            if not net.hasEdge(edge):
                known = [e.getID() for e in net.getEdges(withInternal=False)]
                shown = ", ".join(known[:8]) + (", ..." if len(known) > 8 else "")
                raise EdgesError(f"{path}: no edge {edge!r}; the network has {len(known)} edges: {shown}")
            self.parts.append(net.getEdge(edge))
        self.lanes = [strips(part, path) for part in self.parts]  # from the left
        self.links = [self._link(net, i) for i in range(len(edges) - 1)]
        shift = np.cumsum([0] + [self._shift(link) for link in self.links])
        self.first = [int(s) for s in shift - shift.min()]  # column of the leftmost lane of each edge
        self.columns = max(f + len(lanes) for f, lanes in zip(self.first, self.lanes, strict=True))

    def _link(self, net: Any, i: int) -> dict[tuple[int, int], np.ndarray]:
        """Connections from edge i to edge i + 1: (position, position) -> points inside the junction."""
        found = {}
        position = [{lane.getID(): p for p, lane in enumerate(self.lanes[j])} for j in (i, i + 1)]
        for connection in self.parts[i].getOutgoing().get(self.parts[i + 1], []):
            ends = connection.getFromLane().getID(), connection.getToLane().getID()
            if ends[0] in position[0] and ends[1] in position[1]:  # not a sidewalk's
                key = position[0][ends[0]], position[1][ends[1]]
                found[key] = self._inside(net, connection.getViaLaneID())
        if not found:
            a, b = self.edges[i], self.edges[i + 1]
            followers = ", ".join(e.getID() for e in self.parts[i].getOutgoing()) or "nothing"
            raise EdgesError(f"{self.path}: edge {a!r} does not lead to {b!r}; it leads to {followers}")
        return found

    def _inside(self, net: Any, via: str) -> np.ndarray:
        shapes = []
        while via:
            lane = net.getLane(via)
            if len(lane.getShape()):
                shapes.append(points_of(lane))
            onward = lane.getOutgoing()
            via = onward[0].getViaLaneID() if onward else ""
        return np.concatenate(shapes) if shapes else np.empty((0, 2))

    @staticmethod
    def _shift(link: dict[tuple[int, int], np.ndarray]) -> int:
        """Columns by which edge i + 1 begins to the right (+) of edge i: the connections' vote."""
        shifts = [a - b for a, b in link]
        return max(sorted(set(shifts), key=abs), key=shifts.count)

    def has(self, i: int, column: int) -> bool:
        """Whether edge i has a lane in the column."""
        return 0 <= column - self.first[i] < len(self.lanes[i])

    def runs(self, column: int) -> list[tuple[int, int]]:
        """Stretches (first edge, last edge) over which the column goes on without a break."""
        out: list[tuple[int, int]] = []
        for i in range(len(self.edges)):
            if not self.has(i, column):
                continue
            joined = out and out[-1][1] == i - 1 and self.joint(i - 1, column) is not None
            out = [*out[:-1], (out[-1][0], i)] if joined else [*out, (i, i)]
        return out

    def joint(self, i: int, column: int) -> np.ndarray | None:
        """Points of the column inside the junction after edge i, None where the lanes are not connected."""
        return self.links[i].get((column - self.first[i], column - self.first[i + 1]))

    def breaks(self) -> list[tuple[str, str, int]]:
        """(edge, next edge, lane number) of lanes that both edges have without a connection between them."""
        return [
            (self.edges[i], self.edges[i + 1], column + 1)
            for i in range(len(self.edges) - 1)
            for column in range(self.columns)
            if self.has(i, column) and self.has(i + 1, column) and self.joint(i, column) is None
        ]

    def lane(self, i: int, column: int) -> Any:
        """The sumolib lane of edge i in the column."""
        return self.lanes[i][column - self.first[i]]

    def polyline(self, run: tuple[int, int], column: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Centre points (n, 2) of a run, the lane's width at each and the edge each belongs to."""
        points, widths, owner = [], [], []
        for i in range(run[0], run[1] + 1):
            lane = self.lane(i, column)
            shape = resample(points_of(lane), 1.0)
            points.append(shape)
            widths.append(np.full(len(shape), lane.getWidth()))
            owner.append(np.full(len(shape), i))
            joint = self.joint(i, column) if i < run[1] else None
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
            shape = points_of(lane)
            aside = (position - (column - self.first[i])) * lane.getWidth()
            if aside:
                tangent = np.gradient(shape, axis=0)
                tangent /= np.hypot(*tangent.T)[:, None]
                shape = shape + aside * np.column_stack([-tangent[:, 1], tangent[:, 0]])
            points.append(shape)
            joint = self.joint(i, column) if i + 1 < len(self.edges) and self.has(i, column) else None
            if joint is not None:
                points.append(joint)
        return drop_repeats(np.concatenate(points))
