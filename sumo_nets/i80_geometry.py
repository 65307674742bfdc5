"""I-80 at Emeryville, northbound (signed eastbound): the motorway made from the raw geometry.

Upstream the road follows the lane lines of NGSIM's CAD drawing, which are exact to centimetres but end after
1.5 km; downstream it follows OpenStreetMap. deploy/decisions/0001-i80-geometry.md says how the two are joined
and what differs from the real road.
"""

from __future__ import annotations

import gzip
import json
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from sumo_nets.curves import Curve, arc_length, even_curve, resample, smooth_curve
from sumo_nets.errors import NetworkError
from sumo_nets.motorway import Motorway, Ramp, Section, expectations, tolerance
from sumo_nets.projection import PROJ, to_utm

LANE_WIDTH_M = 3.66  # 12 ft, the CAD lines' spacing is 3.65 m
LANES = 6
# 55 mph, OpenStreetMap maxspeed of all ways used, the ramps too; the HOV lane has no other limit
SPEED_MPS = 24.59
NET_OFFSET = (-561500.0, -4187500.0)  # added to UTM 10N metres
LENGTH_M = 2051.0  # the corridor of whole metres read from the built net has 2050 m
SMOOTHING_M = 150.0  # undulations of the drawn lines shorter than this are taken out
RAMP_POINT_STEP_M = 20.0  # vertex spacing on the ramps

# Stations of the cross-section's changes, read off the CAD lines (see the decision record).
JOIN_START_M = 1470.0  # here the road leaves the CAD lines ...
JOIN_LENGTH_M = 400.0  # ... and is on OpenStreetMap's line this much later
MERGE_M = 835.0  # tip of the Powell Street gore: the on-ramp lies beside lane 6 at full width
MERGE_END_M = 950.0  # the CAD's outer line is back at lane 6
DIVERGE_START_M = 1200.0  # the CAD's outer line begins to widen for Ashby
DIVERGE_M = 1270.0  # tip of the Ashby gore: the off-ramp lies beside lane 6 at full width
RAMP_OVERLAP_M = 60.0  # a ramp's line is smoothed together with this much of the auxiliary lane

GEOMETRY_FILES = ("ngsim_cad_lines_wgs84.geojson", "sac_vsl_i80.net.xml.gz")


@dataclass(frozen=True)
class RawGeometry:
    """Polylines (n, 2) in the net's frame: the CAD drawing's lines and OpenStreetMap's lanes, by name."""

    cad: dict[str, np.ndarray]
    osm: dict[str, np.ndarray]


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


def make_road(raw: RawGeometry) -> Motorway:
    """Join the CAD and OpenStreetMap lines to one smooth road of LENGTH_M with its two ramps.

    The reference line lies between lanes 3 and 4.
    """
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
    return Motorway(
        reference,
        "south_end",
        SECTIONS,
        LANES,
        LANE_WIDTH_M,
        SPEED_MPS,
        Ramp("powell_on_ramp", on_ramp, "powell_gore", "powell_start"),
        Ramp("ashby_off_ramp", off_ramp, "ashby_gore", "ashby_end"),
        hov=True,
        net_offset=NET_OFFSET,
        projection=PROJ,
    )


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


SECTIONS = (
    Section("i80_south", 0.0, MERGE_M, LANES, "powell_gore"),
    Section("i80_powell_merge", MERGE_M, MERGE_END_M, LANES + 1, "powell_lane_end"),
    Section("i80_middle", MERGE_END_M, DIVERGE_START_M, LANES, "ashby_lane_start"),
    Section("i80_ashby_diverge", DIVERGE_START_M, DIVERGE_M, LANES + 1, "ashby_gore"),
    Section("i80_north", DIVERGE_M, LENGTH_M, LANES, "north_end"),
)


def description(road: Motorway) -> dict:
    """corridor.json: the edges in driving order and what the check expects of the road."""
    cad = [("cad/centerline1", 1, 0.0), ("cad/centerline2", 2, 0.0), ("cad/centerline3", 3, 567.0)]
    cad += [("cad/centerline4", 4, 567.0), ("cad/centerline5", 5, 475.0), ("cad/centerline6", 6, 475.0)]
    comparisons = []
    for line, lane, start in cad:
        # lanes 5 and 6 swerve on the drawing where the ramps join and leave; ours stay parallel
        end = DIVERGE_START_M if lane == 6 else JOIN_START_M
        swerves = lane >= 5
        comparisons.append(tolerance(line, lane, start, end, 0.1, 0.9 if swerves else 0.2, 1.0))
    joined = JOIN_START_M + JOIN_LENGTH_M
    middle = "osm/i80_downstream_n_2"
    comparisons.append(tolerance(middle, 3, JOIN_START_M, joined, 1.5, 2.0, 2.2))
    for lane in range(1, 6):
        line = f"osm/i80_downstream_n_{5 - lane}"
        # OpenStreetMap's lanes are 3.2 m wide, so away from the middle lane theirs and ours differ
        aside = abs(lane - 3) * (LANE_WIDTH_M - 3.2)
        comparisons.append(tolerance(line, lane, joined, LENGTH_M, *(aside + t for t in (0.2, 0.3, 0.4))))
    return expectations(road, (2000.0, 2100.0), LANES, LANE_WIDTH_M, comparisons)


def reference_lines(raw: RawGeometry) -> dict:
    """What the check compares the net with, small enough to ship: CAD and OSM lines in the net's frame."""

    def rounded(line: np.ndarray) -> list[list[float]]:
        return np.round(resample(line, 5.0), 2).tolist()

    return {
        "frame": {"projection": PROJ, "net_offset_m": list(NET_OFFSET)},
        "cad": {name: rounded(line) for name, line in sorted(raw.cad.items())},
        "osm": {name: rounded(line) for name, line in sorted(raw.osm.items()) if name.startswith("i80_")},
    }
