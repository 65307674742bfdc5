"""A motorway carriageway with ramps as plain SUMO XML: nodes, edges, connections.

The mainline is cut into short edges: SUMO's moveToXY looks at every vertex of every lane of the edges nearby, so a
world that places vehicles each step is as fast as edges are short and vertices few
(deploy/decisions/0001-i80-geometry.md has the measurement).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np

from sumo_nets.curves import Curve

EDGE_M = 42.0  # the mainline's edges are no longer than this
# vertex spacing: ripples of this length are taken out when the lanes are read (chain.SMOOTHING_M)
CHORD_M = 21.0
HOV_ALLOW = "hov bus coach motorcycle emergency authority army vip"
GENERAL_DISALLOW = "tram rail_urban rail rail_electric rail_fast ship cable_car subway bicycle pedestrian"


@dataclass(frozen=True)
class Section:
    """A stretch of the mainline with one number of lanes."""

    name: str
    start_m: float
    end_m: float
    lanes: int
    end_node: str


@dataclass(frozen=True)
class Ramp:
    """A one-lane ramp: its edge, its centre line (n, 2), the mainline's node where it
    joins or leaves, its other end."""

    edge: str
    points: np.ndarray
    gore: str
    far_end: str


@dataclass(frozen=True)
class Piece:
    """An edge of the mainline."""

    edge: str
    start_m: float
    end_m: float
    lanes: int
    from_node: str
    to_node: str


@dataclass(frozen=True)
class Motorway:
    """The reference line is the middle of `lanes` through lanes, in net metres; further lanes lie to their right."""

    reference: Curve
    start_node: str
    sections: tuple[Section, ...]
    lanes: int
    lane_width_m: float
    speed_mps: float
    on_ramp: Ramp
    off_ramp: Ramp
    hov: bool  # whether the leftmost lane is for high-occupancy vehicles
    net_offset: tuple[float, float]  # added to the projection's metres
    projection: str

    @cached_property
    def mainline(self) -> tuple[Piece, ...]:
        """The edges in driving order."""
        pieces: list[Piece] = []
        for section in self.sections:
            length = section.end_m - section.start_m
            cuts = np.linspace(section.start_m, section.end_m, int(np.ceil(length / EDGE_M)) + 1)
            for i, (a, b) in enumerate(pairwise(cuts.tolist()), 1):
                name = section.name if len(cuts) == 2 else f"{section.name}_{i}"
                before = pieces[-1].to_node if pieces else self.start_node
                after = section.end_node if b == section.end_m else f"{name}_joint"
                pieces.append(Piece(name, a, b, section.lanes, before, after))
        return tuple(pieces)

    def plain_xml(self) -> dict[str, str]:
        """The plain XML sources by suffix: nod, edg, con."""
        return {"nod": self._nodes(), "edg": self._edges(), "con": self._connections()}

    def _left_border(self, start: float, end: float) -> np.ndarray:
        stations = np.linspace(start, end, int(np.ceil((end - start) / CHORD_M)) + 1)
        return np.column_stack(self.reference.to_xy(stations, self.lanes / 2 * self.lane_width_m)[:2])

    def _nodes(self) -> str:
        stations = [0.0, *(piece.end_m for piece in self.mainline)]
        x, y, _ = self.reference.to_xy(np.array(stations), self.lanes / 2 * self.lane_width_m)
        rows = [*zip([self.start_node, *(piece.to_node for piece in self.mainline)], x, y, strict=True)]
        rows += [
            (self.on_ramp.far_end, *self.on_ramp.points[0]),
            (self.off_ramp.far_end, *self.off_ramp.points[-1]),
        ]
        dead_ends = (self.start_node, self.sections[-1].end_node, self.on_ramp.far_end, self.off_ramp.far_end)
        offset = ",".join(f"{v:.2f}" for v in self.net_offset)
        corners = np.array([[r[1], r[2]] for r in rows])
        bounds = ",".join(f"{v:.2f}" for v in (*corners.min(axis=0), *corners.max(axis=0)))
        lines = [
            f'    <location netOffset="{offset}" convBoundary="{bounds}" origBoundary="{bounds}"'
            f' projParameter="{self.projection}"/>'
        ]
        for name, east, north in rows:
            kind = "dead_end" if name in dead_ends else "priority"
            lines.append(f'    <node id="{name}" x="{east:.4f}" y="{north:.4f}" type="{kind}"/>')
        return _document("nodes", lines)

    def _edges(self) -> str:
        lines = []
        for piece in self.mainline:
            opened = (
                f'    <edge id="{piece.edge}" from="{piece.from_node}" to="{piece.to_node}" priority="14"'
                f' type="highway.motorway" numLanes="{piece.lanes}" speed="{self.speed_mps}"'
                f' width="{self.lane_width_m}"'
                f' spreadType="right" disallow="{GENERAL_DISALLOW}"'
                f' shape="{_shape(self._left_border(piece.start_m, piece.end_m))}"'
            )
            if not self.hov:
                lines.append(f"{opened}/>")
                continue
            lines.append(f"{opened}>")
            lines.append(f'        <lane index="{piece.lanes - 1}" allow="{HOV_ALLOW}"/>')
            lines.append("    </edge>")
        for ramp, a, b in (
            (self.on_ramp, self.on_ramp.far_end, self.on_ramp.gore),
            (self.off_ramp, self.off_ramp.gore, self.off_ramp.far_end),
        ):
            lines.append(
                f'    <edge id="{ramp.edge}" from="{a}" to="{b}" priority="9" type="highway.motorway_link"'
                f' numLanes="1" speed="{self.speed_mps}" width="{self.lane_width_m}" spreadType="center"'
                f' disallow="{GENERAL_DISALLOW}" shape="{_shape(ramp.points)}"/>'
            )
        return _document("edges", lines)

    def _connections(self) -> str:
        """Through lanes go on; a lane that opens without a ramp is reached from the lane beside it."""
        through, opening, ramps = [], [], []
        for a, b in pairwise(self.mainline):
            shared = a.lanes if a.lanes == b.lanes else self.lanes
            through += [
                _connection(a.edge, b.edge, lane + a.lanes - shared, lane + b.lanes - shared)
                for lane in range(shared)
            ]
            if b.from_node == self.on_ramp.gore:
                ramps.append(_connection(self.on_ramp.edge, b.edge, 0, 0))
            elif b.lanes > a.lanes:
                opening.append(_connection(a.edge, b.edge, 0, 0))
            if a.to_node == self.off_ramp.gore:
                ramps.append(_connection(a.edge, self.off_ramp.edge, 0, 0))
        return _document("connections", [*through, *opening, *ramps])


def _connection(a: str, b: str, from_lane: int, to_lane: int) -> str:
    return f'    <connection from="{a}" to="{b}" fromLane="{from_lane}" toLane="{to_lane}"/>'


def _shape(points: np.ndarray) -> str:
    return " ".join(f"{x:.4f},{y:.4f}" for x, y in points)


def _document(tag: str, lines: list[str]) -> str:
    note = "<!-- made by `python -m sumo_nets.build sources`; data attribution in ATTRIBUTION.md -->"
    return f'<?xml version="1.0" encoding="UTF-8"?>\n{note}\n<{tag}>\n' + "\n".join(lines) + f"\n</{tag}>\n"


def tolerance(
    line: str, lane: int, start: float, end: float, median: float, p95: float, worst: float
) -> dict:
    """What the check expects of the distance between a surveyed line and a lane's centre."""
    span = {"line": line, "lane": lane, "from_m": start, "to_m": end}
    return span | {"median_m": round(median, 2), "p95_m": round(p95, 2), "max_m": round(worst, 2)}


def expectations(
    road: Motorway, length_m: tuple[float, float], lanes: int, lane_width_m: float, comparisons: list[dict]
) -> dict:
    """What the check expects of a motorway that is built from surveyed lines.

    length_m: shortest and longest, m
    lanes: of the mainline; an auxiliary lane may lie beside them
    lane_width_m: as built, m
    comparisons: of surveyed lines with lanes' centres, see `tolerance`
    """
    return {
        "edges": [piece.edge for piece in road.mainline],
        "expected": {
            "length_m": list(length_m),
            "lanes": [lanes, lanes + 1],
            "lane_width_m": [lane_width_m - 0.005, lane_width_m + 0.005],
            "max_curvature_per_m": 1.0 / 400.0,
            "max_heading_step_rad_per_m": 1.0 / 400.0,
            "max_curvature_step_per_m2": 1e-4,
            "max_boundary_step_m_per_m": 0.001,
            "max_offset_from_net_m": 0.1,
            "comparisons": comparisons,
        },
    }
