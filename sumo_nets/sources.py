"""I-80 at Emeryville, northbound (signed eastbound): plain SUMO XML made from the raw geometry.

Upstream the road follows the lane lines of NGSIM's CAD drawing, which are exact to centimetres but end after
1.5 km; downstream it follows OpenStreetMap. deploy/decisions/0001-i80-geometry.md says how the two are joined
and what differs from the real road.
"""

from __future__ import annotations

import gzip
import json
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from sumo_nets.curves import Curve, arc_length, even_curve, resample, smooth_curve
from sumo_nets.errors import NetworkError
from sumo_nets.projection import PROJ, to_utm

LANE_WIDTH_M = 3.66  # 12 ft, the CAD lines' spacing is 3.65 m
LANES = 6
SPEED_MPS = 24.59  # 55 mph, OpenStreetMap maxspeed of all ways used; the HOV lane has no other limit
RAMP_SPEED_MPS = 24.59  # OpenStreetMap maxspeed of the Powell Street on-ramp
NET_OFFSET = (-561500.0, -4187500.0)  # added to UTM 10N metres
LENGTH_M = 2051.0  # the corridor of whole metres read from the built net has 2050 m
SMOOTHING_M = 150.0  # undulations of the drawn lines shorter than this are taken out
# SUMO's moveToXY looks at every vertex of every lane of the edges nearby, so a world that places vehicles each step
# is as fast as edges are short and vertices few (deploy/decisions/0001-i80-geometry.md has the measurement).
EDGE_M = 42.0  # the mainline's edges are no longer than this
CHORD_M = (
    21.0  # vertex spacing: ripples of this length are taken out when the lanes are read (chain.SMOOTHING_M)
)
RAMP_POINT_STEP_M = 20.0  # vertex spacing on the ramps

# Stations of the cross-section's changes, read off the CAD lines (see the decision record).
JOIN_START_M = 1470.0  # here the road leaves the CAD lines ...
JOIN_LENGTH_M = 400.0  # ... and is on OpenStreetMap's line this much later
MERGE_M = 835.0  # tip of the Powell Street gore: the on-ramp lies beside lane 6 at full width
MERGE_END_M = 950.0  # the CAD's outer line is back at lane 6
DIVERGE_START_M = 1200.0  # the CAD's outer line begins to widen for Ashby
DIVERGE_M = 1270.0  # tip of the Ashby gore: the off-ramp lies beside lane 6 at full width
RAMP_OVERLAP_M = 60.0  # a ramp's line is smoothed together with this much of the auxiliary lane

HOV_ALLOW = "hov bus coach motorcycle emergency authority army vip"
GENERAL_DISALLOW = "tram rail_urban rail rail_electric rail_fast ship cable_car subway bicycle pedestrian"

GEOMETRY_FILES = ("ngsim_cad_lines_wgs84.geojson", "sac_vsl_i80.net.xml.gz")


@dataclass(frozen=True)
class RawGeometry:
    """Polylines (n, 2) in the net's frame: the CAD drawing's lines and OpenStreetMap's lanes, by name."""

    cad: dict[str, np.ndarray]
    osm: dict[str, np.ndarray]


@dataclass(frozen=True)
class Road:
    """The mainline's reference line (between lanes 3 and 4) and the ramps' centre lines, in net metres."""

    reference: Curve
    on_ramp: np.ndarray
    off_ramp: np.ndarray


def read_geometry(folder: Path) -> RawGeometry:
    """Read the CAD lines and the OpenStreetMap lanes from `folder`; NetworkError if a file is missing."""
    for name in GEOMETRY_FILES:
        if not (folder / name).is_file():
            needed = ", ".join(GEOMETRY_FILES)
            raise NetworkError(f"{folder / name} is missing; the geometry folder must hold {needed}")
    cad = {}
    for feature in json.loads((folder / GEOMETRY_FILES[0]).read_text(encoding="utf-8"))["features"]:
        lon, lat = np.array(feature["geometry"]["coordinates"], float).T
        cad[feature["properties"]["name"]] = np.column_stack(to_utm(lon, lat)) + NET_OFFSET
    root = ElementTree.fromstring(gzip.decompress((folder / GEOMETRY_FILES[1]).read_bytes()))
    location = root.find("location")
    if location is None:
        raise NetworkError(f"{folder / GEOMETRY_FILES[1]} is not a SUMO network: it has no location")
    theirs = np.array([float(v) for v in location.attrib["netOffset"].split(",")])
    osm = {}
    for lane in root.iter("lane"):
        if lane.attrib["id"].startswith(("i80_", "powell_", "ashby_")):
            points = np.array([[float(v) for v in p.split(",")[:2]] for p in lane.attrib["shape"].split()])
            osm[lane.attrib["id"]] = points - theirs + NET_OFFSET
    return RawGeometry(cad, osm)


def make_road(raw: RawGeometry) -> Road:
    """Join the CAD and OpenStreetMap lines to one smooth road of LENGTH_M with its two ramps."""
    reference = _reference(raw)
    auxiliary = -(LANES / 2 + 0.5) * LANE_WIDTH_M

    merge = np.arange(MERGE_M, MERGE_M + RAMP_OVERLAP_M)
    beside = np.column_stack(reference.to_xy(merge, auxiliary)[:2])
    both = [resample(raw.osm[f"powell_acc_{i}"], 1.0)[:-5] for i in (0, 1)]  # two lanes that become one
    upstream = np.mean([line[: min(map(len, both))] for line in both], axis=0)
    powell = np.concatenate([upstream, _cut(raw.cad["onramp"], beside[0], keep="before"), beside])
    on_ramp = _part(smooth_curve(powell, 60.0), reference, MERGE_M, before=True)

    diverge = np.arange(DIVERGE_M - RAMP_OVERLAP_M, DIVERGE_M + 0.5)
    beside = np.column_stack(reference.to_xy(diverge, auxiliary)[:2])
    ashby = np.concatenate([beside, _cut(raw.cad["offramp"], beside[-1], keep="after")])
    off_ramp = _part(smooth_curve(ashby, 60.0), reference, DIVERGE_M, before=False)
    return Road(reference, on_ramp, off_ramp)


def _reference(raw: RawGeometry) -> Curve:
    """Line between lanes 3 and 4: mean of the CAD centre lines, then OpenStreetMap's carriageway centre."""
    first = smooth_curve(raw.cad["centerline1"], 60.0)
    stations = np.arange(len(first.x)) * 1.0
    to_middle = (0.5 - LANES / 2) * LANE_WIDTH_M
    votes = []
    for lane in (1, 2, 3, 4):
        s, offset = first.project(*resample(raw.cad[f"centerline{lane}"], 1.0).T)
        nominal = offset + (lane - 1) * LANE_WIDTH_M
        votes.append(np.interp(stations, s, nominal, left=np.nan, right=np.nan))
    middle = np.nanmean(votes, axis=0) + to_middle
    cad = first.shifted(middle)[: int(JOIN_START_M) + 1]

    # OpenStreetMap has 5 lanes here: the middle of its carriageway is the centre of lane 3
    five = [resample(raw.osm[f"i80_downstream_n_{i}"], 1.0) for i in range(5)]
    centre = smooth_curve(np.mean([line[: min(map(len, five))] for line in five], axis=0), SMOOTHING_M)
    osm = even_curve(centre.shifted(-LANE_WIDTH_M / 2), 1.0)
    start, step_aside = (float(v) for v in osm.project(*cad[-1]))
    onward = np.arange(np.ceil(start + 1.0), osm.length_m)
    u = np.clip((onward - start) / JOIN_LENGTH_M, 0.0, 1.0)
    fade = 1.0 - u**3 * (10.0 - 15.0 * u + 6.0 * u**2)  # C2 from 1 to 0
    downstream = np.column_stack(osm.to_xy(onward, step_aside * fade)[:2])
    smooth = smooth_curve(np.concatenate([cad, downstream]), SMOOTHING_M)
    return even_curve(np.column_stack([smooth.x, smooth.y]), 1.0, length_m=LENGTH_M)


def _cut(line: np.ndarray, at: np.ndarray, keep: str) -> np.ndarray:
    """The part of `line` at least 15 m before or after the point of it nearest to `at` (room to blend)."""
    line = resample(line, 1.0)
    along = arc_length(line)
    here = along[np.argmin(np.hypot(*(line - at).T))]
    return line[along < here - 15.0] if keep == "before" else line[along > here + 15.0]


def _part(curve: Curve, reference: Curve, station_m: float, before: bool) -> np.ndarray:
    """Points of `curve` before or after `station_m` of the reference line."""
    s, _ = reference.project(curve.x, curve.y)
    points = np.column_stack([curve.x, curve.y])
    inside = s < station_m - 0.5 if before else s > station_m + 0.5
    return points[inside][:: int(RAMP_POINT_STEP_M)]


SECTIONS = (  # section, from station, to station, lanes, the node at its end
    ("i80_south", 0.0, MERGE_M, LANES, "powell_gore"),
    ("i80_powell_merge", MERGE_M, MERGE_END_M, LANES + 1, "powell_lane_end"),
    ("i80_middle", MERGE_END_M, DIVERGE_START_M, LANES, "ashby_lane_start"),
    ("i80_ashby_diverge", DIVERGE_START_M, DIVERGE_M, LANES + 1, "ashby_gore"),
    ("i80_north", DIVERGE_M, LENGTH_M, LANES, "north_end"),
)


@dataclass(frozen=True)
class Piece:
    """An edge of the mainline."""

    edge: str
    start_m: float
    end_m: float
    lanes: int
    from_node: str
    to_node: str


def _mainline() -> tuple[Piece, ...]:
    pieces: list[Piece] = []
    for section, start, end, lanes, node in SECTIONS:
        cuts = np.linspace(start, end, int(np.ceil((end - start) / EDGE_M)) + 1)
        for i, (a, b) in enumerate(pairwise(cuts.tolist()), 1):
            name = section if len(cuts) == 2 else f"{section}_{i}"
            before = pieces[-1].to_node if pieces else "south_end"
            after = node if b == end else f"{name}_joint"
            pieces.append(Piece(name, a, b, lanes, before, after))
    return tuple(pieces)


MAINLINE = _mainline()
BEFORE_ASHBY = next(piece for piece in MAINLINE if piece.to_node == "ashby_lane_start")
MERGE = next(piece for piece in MAINLINE if piece.from_node == "powell_gore")
DIVERGE = next(piece for piece in MAINLINE if piece.to_node == "ashby_gore")
AFTER_ASHBY_LANE = next(piece for piece in MAINLINE if piece.from_node == "ashby_lane_start")
DEAD_ENDS = ("south_end", "north_end", "powell_start", "ashby_end")


def plain_xml(road: Road) -> dict[str, str]:
    """The plain XML sources by suffix: nod, edg, con."""
    return {"nod": _nodes(road), "edg": _edges(road), "con": _connections()}


def _left_border(road: Road, start: float, end: float) -> np.ndarray:
    stations = np.linspace(start, end, int(np.ceil((end - start) / CHORD_M)) + 1)
    return np.column_stack(road.reference.to_xy(stations, LANES / 2 * LANE_WIDTH_M)[:2])


def _shape(points: np.ndarray) -> str:
    return " ".join(f"{x:.4f},{y:.4f}" for x, y in points)


def _nodes(road: Road) -> str:
    stations = [0.0, *(piece.end_m for piece in MAINLINE)]
    x, y, _ = road.reference.to_xy(np.array(stations), LANES / 2 * LANE_WIDTH_M)
    rows = [*zip(["south_end", *(piece.to_node for piece in MAINLINE)], x, y, strict=True)]
    rows += [("powell_start", *road.on_ramp[0]), ("ashby_end", *road.off_ramp[-1])]
    offset = ",".join(f"{v:.2f}" for v in NET_OFFSET)
    corners = np.array([[r[1], r[2]] for r in rows])
    bounds = ",".join(f"{v:.2f}" for v in (*corners.min(axis=0), *corners.max(axis=0)))
    lines = [
        f'    <location netOffset="{offset}" convBoundary="{bounds}" origBoundary="{bounds}"'
        f' projParameter="{PROJ}"/>'
    ]
    for name, east, north in rows:
        kind = "dead_end" if name in DEAD_ENDS else "priority"
        lines.append(f'    <node id="{name}" x="{east:.4f}" y="{north:.4f}" type="{kind}"/>')
    return _document("nodes", lines)


def _edges(road: Road) -> str:
    lines = []
    for piece in MAINLINE:
        lines.append(
            f'    <edge id="{piece.edge}" from="{piece.from_node}" to="{piece.to_node}" priority="14"'
            f' type="highway.motorway" numLanes="{piece.lanes}" speed="{SPEED_MPS}" width="{LANE_WIDTH_M}"'
            f' spreadType="right" disallow="{GENERAL_DISALLOW}"'
            f' shape="{_shape(_left_border(road, piece.start_m, piece.end_m))}">'
        )
        lines.append(f'        <lane index="{piece.lanes - 1}" allow="{HOV_ALLOW}"/>')
        lines.append("    </edge>")
    for name, a, b, points in (
        ("powell_on_ramp", "powell_start", "powell_gore", road.on_ramp),
        ("ashby_off_ramp", "ashby_gore", "ashby_end", road.off_ramp),
    ):
        lines.append(
            f'    <edge id="{name}" from="{a}" to="{b}" priority="9" type="highway.motorway_link"'
            f' numLanes="1" speed="{RAMP_SPEED_MPS}" width="{LANE_WIDTH_M}" spreadType="center"'
            f' disallow="{GENERAL_DISALLOW}" shape="{_shape(points)}"/>'
        )
    return _document("edges", lines)


def _connections() -> str:
    lines = []
    for a, b in pairwise(MAINLINE):
        shared = min(a.lanes, b.lanes) if a.lanes == b.lanes else LANES
        for lane in range(shared):
            lines.append(_connection(a.edge, b.edge, lane + a.lanes - shared, lane + b.lanes - shared))
    lines.append(_connection(BEFORE_ASHBY.edge, AFTER_ASHBY_LANE.edge, 0, 0))
    lines.append(_connection("powell_on_ramp", MERGE.edge, 0, 0))
    lines.append(_connection(DIVERGE.edge, "ashby_off_ramp", 0, 0))
    return _document("connections", lines)


def _connection(a: str, b: str, from_lane: int, to_lane: int) -> str:
    return f'    <connection from="{a}" to="{b}" fromLane="{from_lane}" toLane="{to_lane}"/>'


def _document(tag: str, lines: list[str]) -> str:
    note = "<!-- made by `python -m sumo_nets.build sources`; data attribution in ATTRIBUTION.md -->"
    return f'<?xml version="1.0" encoding="UTF-8"?>\n{note}\n<{tag}>\n' + "\n".join(lines) + f"\n</{tag}>\n"


def description() -> dict:
    """corridor.json: the edges in driving order and what the check expects of the road."""
    cad = [("cad/centerline1", 1, 0.0), ("cad/centerline2", 2, 0.0), ("cad/centerline3", 3, 567.0)]
    cad += [("cad/centerline4", 4, 567.0), ("cad/centerline5", 5, 475.0), ("cad/centerline6", 6, 475.0)]
    comparisons = []
    for line, lane, start in cad:
        # lanes 5 and 6 swerve on the drawing where the ramps join and leave; ours stay parallel
        end = DIVERGE_START_M if lane == 6 else JOIN_START_M
        swerves = lane >= 5
        comparisons.append(_tolerance(line, lane, start, end, 0.1, 0.9 if swerves else 0.2, 1.0))
    joined = JOIN_START_M + JOIN_LENGTH_M
    middle = "osm/i80_downstream_n_2"
    comparisons.append(_tolerance(middle, 3, JOIN_START_M, joined, 1.5, 2.0, 2.2))
    for lane in range(1, 6):
        line = f"osm/i80_downstream_n_{5 - lane}"
        # OpenStreetMap's lanes are 3.2 m wide, so away from the middle lane theirs and ours differ
        aside = abs(lane - 3) * (LANE_WIDTH_M - 3.2)
        comparisons.append(_tolerance(line, lane, joined, LENGTH_M, *(aside + t for t in (0.2, 0.3, 0.4))))
    return {
        "edges": [piece.edge for piece in MAINLINE],
        "expected": {
            "length_m": [2000.0, 2100.0],
            "lanes": [LANES, LANES + 1],
            "lane_width_m": [LANE_WIDTH_M - 0.005, LANE_WIDTH_M + 0.005],
            "max_curvature_per_m": 1.0 / 400.0,
            "max_heading_step_rad_per_m": 1.0 / 400.0,
            "max_curvature_step_per_m2": 1e-4,
            "max_boundary_step_m_per_m": 0.001,
            "max_offset_from_net_m": 0.1,
            "comparisons": comparisons,
        },
    }


def _tolerance(
    line: str, lane: int, start: float, end: float, median: float, p95: float, worst: float
) -> dict:
    span = {"line": line, "lane": lane, "from_m": start, "to_m": end}
    return span | {"median_m": round(median, 2), "p95_m": round(p95, 2), "max_m": round(worst, 2)}


def reference_lines(raw: RawGeometry) -> dict:
    """What the check compares the net with, small enough to ship: CAD and OSM lines in the net's frame."""

    def rounded(line: np.ndarray) -> list[list[float]]:
        return np.round(resample(line, 5.0), 2).tolist()

    return {
        "frame": {"projection": PROJ, "net_offset_m": list(NET_OFFSET)},
        "cad": {name: rounded(line) for name, line in sorted(raw.cad.items())},
        "osm": {name: rounded(line) for name, line in sorted(raw.osm.items()) if name.startswith("i80_")},
    }
