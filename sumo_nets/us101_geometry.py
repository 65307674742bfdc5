"""US-101 at Los Angeles, southbound (Hollywood Freeway): the motorway made from the raw geometry.

The lane lines of NGSIM's CAD drawing, five through lanes and an auxiliary lane between the on-ramp from Ventura
Boulevard and the off-ramp to Cahuenga Boulevard.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from sumo_nets.curves import even_curve, resample, smooth_curve
from sumo_nets.errors import NetworkError
from sumo_nets.motorway import Motorway, Ramp, Section, expectations, tolerance

FOOT_M = 1200.0 / 3937.0  # the US survey foot, in which the drawing is
LANE_WIDTH_M = 3.46  # the mean distance of the drawn centre lines
LANES = 5
SPEED_MPS = 24.59  # 55 mph, as posted
NET_OFFSET = (-1966200.0, -570350.0)  # added to metres of California State Plane zone 5
PROJ = (
    "+proj=lcc +lat_0=33.5 +lon_0=-118 +lat_1=35.4666666666667 +lat_2=34.0333333333333"
    " +x_0=2000000.0001016 +y_0=500000.0001016 +datum=NAD83 +units=m +no_defs"
)
LENGTH_M = 736.0
SMOOTHING_M = 60.0
RAMP_POINT_STEP_M = 20.0  # vertex spacing on the ramps
RAMP_OVERLAP_M = 40.0  # a ramp's line is smoothed together with this much of the auxiliary lane
MERGE_M = 207.0  # the drawing's lane 5 gets a right neighbour here ...
DIVERGE_M = 419.0  # ... and loses it here

GEOMETRY_FILES = ("sisl_centerlines101.txt",)
SECTIONS = (
    Section("us101_north", 0.0, MERGE_M, LANES, "ventura_gore"),
    Section("us101_auxiliary", MERGE_M, DIVERGE_M, LANES + 1, "cahuenga_gore"),
    Section("us101_south", DIVERGE_M, LENGTH_M, LANES, "south_end"),
)


def read_geometry(folder: Path) -> dict[str, np.ndarray]:
    """The drawing's centre lines (n, 2) in the net's frame, by name; NetworkError if the file is missing or broken."""
    path = folder / GEOMETRY_FILES[0]
    if not path.is_file():
        raise NetworkError(f"{path} is missing; the geometry folder must hold {GEOMETRY_FILES[0]}")
    rows = iter(path.read_text(encoding="utf-8").split("\n"))
    try:
        if next(rows).strip() != "CENTERLINES":
            raise ValueError("it does not begin with CENTERLINES")
        lines = {}
        for _ in range(int(next(rows))):
            _, name, count = next(rows), next(rows).strip(), int(next(rows))
            points = [next(rows).split()[:2] for _ in range(count)]
            lines[name] = np.array(points, float) * FOOT_M + NET_OFFSET
    except (ValueError, StopIteration) as error:
        raise NetworkError(f"{path} is not a list of centre lines: {error or 'it ends too early'}") from error
    return lines


def make_road(raw: dict[str, np.ndarray]) -> Motorway:
    """A smooth road of LENGTH_M along the centre of lane 3, with its two ramps."""
    smooth = smooth_curve(raw["centerline3"], SMOOTHING_M)
    reference = even_curve(np.column_stack([smooth.x, smooth.y]), 1.0, length_m=LENGTH_M)
    auxiliary = -(LANES / 2 + 0.5) * LANE_WIDTH_M
    drawn = resample(raw["auxilliary"], 1.0)
    station, _ = reference.project(*drawn.T)

    def beside(start: float, end: float) -> np.ndarray:
        return np.column_stack(reference.to_xy(np.arange(start, end + 0.5), auxiliary)[:2])

    joining = np.concatenate([drawn[station < MERGE_M - 15.0], beside(MERGE_M, MERGE_M + RAMP_OVERLAP_M)])
    leaving = np.concatenate(
        [beside(DIVERGE_M - RAMP_OVERLAP_M, DIVERGE_M), drawn[station > DIVERGE_M + 15.0]]
    )
    ramps = []
    for points, at, before in ((joining, MERGE_M, True), (leaving, DIVERGE_M, False)):
        line = smooth_curve(points, 30.0)
        s, _ = reference.project(line.x, line.y)
        inside = s < at - 0.5 if before else s > at + 0.5
        ramps.append(np.column_stack([line.x, line.y])[inside][:: int(RAMP_POINT_STEP_M)])
    return Motorway(
        reference,
        "north_end",
        SECTIONS,
        LANES,
        LANE_WIDTH_M,
        SPEED_MPS,
        Ramp("ventura_on_ramp", ramps[0], "ventura_gore", "ventura_start"),
        Ramp("cahuenga_off_ramp", ramps[1], "cahuenga_gore", "cahuenga_end"),
        hov=False,
        net_offset=NET_OFFSET,
        projection=PROJ,
    )


def description(road: Motorway) -> dict:
    """corridor.json: the edges in driving order and what the check expects of the road."""
    comparisons = [
        tolerance(f"cad/centerline{lane}", lane, 2.0, LENGTH_M - 4.0, 0.2, 0.35, 0.5)
        for lane in range(1, LANES + 1)
    ]
    comparisons.append(
        tolerance("cad/auxilliary", LANES + 1, MERGE_M + 3.0, DIVERGE_M - 3.0, 0.25, 0.35, 0.5)
    )
    return expectations(road, (720.0, 741.0), LANES, LANE_WIDTH_M, comparisons)


def reference_lines(raw: dict[str, np.ndarray]) -> dict:
    """What the check compares the net with, small enough to ship: the drawing's lines in the net's frame."""
    return {
        "frame": {"projection": PROJ, "net_offset_m": list(NET_OFFSET)},
        "cad": {name: np.round(resample(line, 5.0), 2).tolist() for name, line in sorted(raw.items())},
        "osm": {},
    }
