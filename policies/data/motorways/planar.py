"""Tracks in the plane as recordings along a road, one a direction of travel: stations, lanes, lateral positions.

The directions are told apart by the axis along which most is driven: tracks that go against it are the other
carriageway. A road that turns by more than a right angle cannot be told so.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from datetime import UTC, datetime

import numpy as np
import polars as pl

from policies.data.motorways.road_line import RoadLine, road_line
from policies.data.motorways.tracks import at_ten_hertz
from policies.data.ngsim_flags import finish
from policies.data.ngsim_schema import DT_S
from policies.data.scenes import DataError

COMPASS = ("E", "NE", "N", "NW", "W", "SW", "S", "SE")
FEWEST = 5  # tracks of a direction
FASTEST_MPS = 70.0
SINCE_1970_S = 1e8  # times beyond it are the clock's


@dataclass(frozen=True)
class Direction:
    """A recording of one carriageway: its table in the schema, its name as a site, and its road in the plane."""

    site: str
    table: pl.DataFrame
    line: RoadLine


def recordings(rows: pl.DataFrame, source: str, location: str) -> Iterator[Direction]:
    """The directions of travel of rows.

    rows: vehicle_id, epoch_s, x_m, y_m, speed_mps, length_m, width_m, interpolated (0 or 1), vehicle_class ("" where
        unknown), in m and s; x east, y north
    """
    start = float(rows["epoch_s"].min())  # type: ignore[arg-type]
    clocked = start > SINCE_1970_S
    kinds = rows.group_by("vehicle_id").agg(pl.col("vehicle_class").first())
    moving = rows.with_columns((pl.col("epoch_s") - start).alias("t_s")).drop("epoch_s", "vehicle_class")
    tracks = at_ten_hertz(moving)
    names = dict(kinds.iter_rows())
    clock = datetime.fromtimestamp(start, UTC).strftime("%Y-%m-%dT%H:%M:%SZ") if clocked else "0"
    for towards, part in _directions(tracks):
        line, s, left = road_line(part)
        lane = line.lane_of(left)
        site = f"{location}-{towards}"
        table = part.with_columns(
            pl.lit(source).alias("source"),
            pl.lit(f"{site} {clock}").alias("recording"),
            pl.Series("x_m", s),
            pl.Series("y_m", left),
            pl.Series("lane", lane).replace(0, None),
            (start + pl.col("frame") * DT_S if clocked else pl.lit(None, dtype=pl.Float64)).alias("epoch_s"),
            pl.col("vehicle_id").replace_strict(names).replace("", None).alias("vehicle_class"),
        )
        yield Direction(site, finish(table, complete=True, fastest_mps=FASTEST_MPS), line)


def _directions(tracks: pl.DataFrame) -> list[tuple[str, pl.DataFrame]]:
    """The tracks of each direction, named by the compass."""
    way = tracks.group_by("vehicle_id").agg(
        (pl.col("x_m").last() - pl.col("x_m").first()).alias("dx"),
        (pl.col("y_m").last() - pl.col("y_m").first()).alias("dy"),
    )
    driven = way.select("dx", "dy").to_numpy()
    _, axes = np.linalg.eigh(driven.T @ driven)
    ahead = driven @ axes[:, -1] >= 0.0
    found = []
    for side in (True, False):
        part, ids = driven[ahead == side], way["vehicle_id"].filter(pl.Series(ahead == side))
        if len(part) < FEWEST:
            continue
        turn = np.arctan2(part[:, 1].sum(), part[:, 0].sum())
        name = COMPASS[round(4.0 * turn / np.pi) % 8]
        rows = tracks.filter(pl.col("vehicle_id").is_in(ids.implode())).sort("vehicle_id", "frame")
        found.append((name, rows))
    if not found:
        raise DataError(f"fewer than {FEWEST} tracks in each direction; a road is told by more")
    return found
