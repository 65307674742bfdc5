"""Scenes from imported tables (ngsim_schema.py): what any user with NGSIM's own files trains on.

    tailroad data import trajectories-0400-0415.txt trajectories-0500-0515.txt --out tables
    tailroad train drivers --data tables ...

A table does not know the road's shape: roads become straight. The lanes' centres are the medians of the vehicles'
lateral positions, lane by lane, every CELL_M; from there on a recording is treated as the data pack's (scenes.py).
Recordings are cut into scenes of WINDOW_S, because a scene holds every vehicle in every frame.

A recording can become scenes if all vehicles of the road are in it, with lateral positions, lanes and lengths. Pairs,
chains and moved samples cannot; they are passed over, with the reason. Lane 1 of a recording whose name says i-80 (or
i80) is reserved for high-occupancy vehicles; tables say of no other road that one of its lanes is.
"""

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import polars as pl

from policies.data.ngsim_schema import DT_S, FLAGS, LAYOUTS, SCHEMA
from policies.data.scenes import (
    I80_RESERVED,
    I80_WIDTH_M,
    DataError,
    Scene,
    SceneRoad,
    assemble,
    rectify,
    straight_lanes,
)

WINDOW_S = 120.0
CELL_M = 20.0
CELL_SHARE = 0.1  # a lane's cell with fewer vehicles than this share of the median cell's says nothing
LANE_COVERAGE = 0.5  # share of cells; a lane known in fewer is a ramp, laid beside the last one
SPACING_M = (2.4, 6.0)  # between centres of neighbouring lanes
MARGIN_M = 5.0  # before the first row
AFTER_M = 50.0  # of road after the last
LANE_WIDTH_M = 3.7  # where there is one lane only
RAMP_SHARE = 0.3  # a lane with fewer rows than this share of the median lane's is a ramp
HELD_OUT_SHARE = 0.15  # the last vehicles of each recording (NGSIM numbers them as they enter)
COMPLETE = (  # layouts with every vehicle of the road
    "ngsim-text", "ngsim-csv", "i80-scene", "us101-scene", "dlr-highway", "exid", "highd", "i24-motion",
)  # fmt: skip
SPLIT = FLAGS["jump"][0] | FLAGS["duplicate_frame"][0]  # rows at which a track is broken


def is_table(path: Path) -> bool:
    """Whether `path` is a table in the schema, or a folder with at least one."""
    return any(_in_schema(file) for file in _files(path))


def read_tables(path: Path | str) -> tuple[list[Scene], list[str]]:
    """Scenes of a table, or of all tables in a folder, and why recordings in them were passed over.

    Raises DataError where there is no table, or none with a complete recording.
    """
    path = Path(path)
    files = [file for file in _files(path) if _in_schema(file)]
    if not files:
        raise DataError(
            f"{path}: no imported table found; make one with 'tailroad data import FILE --out DIR' and name DIR"
        )
    found: list[Scene] = []
    passed: list[str] = []
    for file in files:
        try:
            more, unfit = _of_file(file)
        except (pl.exceptions.PolarsError, pl.exceptions.PanicException) as error:
            raise DataError(f"{file}: damaged, it cannot be read ({error}); import it again") from error
        found += more
        passed += unfit
    if not found:
        raise DataError(
            f"{path}: no recording in its tables can be used as a scene ({'; '.join(passed[:3])}); "
            "scenes need every vehicle of a road with lateral position, lane and length"
        )
    return found, passed


def _of_file(file: Path) -> tuple[list[Scene], list[str]]:
    """The scenes of one table, and why recordings in it were passed over."""
    found: list[Scene] = []
    passed: list[str] = []
    table = pl.scan_parquet(file)
    sites: dict[str, list[str]] = {}
    for name in table.select("recording").unique().collect().to_series().sort():
        rows = table.filter(pl.col("recording") == name).head(1_000_000).collect()
        if rows.height == 0:  # the file's index says otherwise than its pages, or the name is missing
            raise DataError(f"{file}: damaged, recording {name!r} has no rows; import it again")
        reason = _unfit(rows)
        if reason:
            passed.append(f"{file.name}, recording {name}: {reason}")
        else:
            sites.setdefault(name.rpartition(" ")[0], []).append(name)
    for names in sites.values():
        road = _road(file, names)
        for name in names:
            found += _scenes(table.filter(pl.col("recording") == name).collect(), name, road)
    return found, passed


def _files(path: Path) -> list[Path]:
    return sorted(path.glob("*.parquet")) if path.is_dir() else [path] if path.is_file() else []


def _in_schema(file: Path) -> bool:
    try:
        return set(SCHEMA) <= set(pl.read_parquet_schema(file))
    except (pl.exceptions.PolarsError, pl.exceptions.PanicException, OSError):
        return False


def _unfit(table: pl.DataFrame) -> str:
    source = table["source"][0]
    if source not in COMPLETE:
        return f"layout {source} ({LAYOUTS.get(source, 'unknown')}) does not hold every vehicle of the road"
    for column in ("x_m", "y_m", "lane"):
        if table[column].null_count() > 0.5 * table.height:
            return f"{column} is unknown"
    return ""


@dataclass(frozen=True)
class _Lanes:
    """A straight road: its first station's x, and the lanes' centres (L, G) to the right at stations `grid` (G,)."""

    origin_m: float
    grid: np.ndarray
    centres: np.ndarray
    road: SceneRoad


def _known(table: pl.LazyFrame) -> pl.LazyFrame:
    return table.filter(pl.all_horizontal(pl.col("x_m", "y_m", "lane").is_not_null()) & (pl.col("lane") > 0))


def _road(file: Path, names: list[str]) -> _Lanes:
    """One road for all recordings of a site: short ones alone do not show every lane."""
    columns = ["recording", "vehicle_id", "x_m", "y_m", "lane"]
    rows = _known(pl.scan_parquet(file).filter(pl.col("recording").is_in(names)).select(columns)).collect()
    origin = float(rows["x_m"].min()) - MARGIN_M  # type: ignore[arg-type]
    s, lane = rows["x_m"].to_numpy() - origin, rows["lane"].to_numpy()
    vehicle = rows.select(pl.struct("recording", "vehicle_id").rank("dense")).to_series().to_numpy()
    grid, centres = lane_centres(f"{file.name}, {names[0]}", s, -rows["y_m"].to_numpy(), lane, vehicle)
    width = (
        float((centres[-1] - centres[0]).mean() / (len(centres) - 1)) if len(centres) > 1 else LANE_WIDTH_M
    )
    if (lane > len(centres)).any():  # a ramp, or an auxiliary lane along a part of the road
        centres = np.vstack([centres, centres[-1] + width])
    reserved = I80_RESERVED if re.search(r"\bi-?80\b", names[0].lower()) else ()
    road = straight_lanes(names[0], float(s.max()) + AFTER_M, len(centres), width, reserved=reserved)
    return _Lanes(origin, grid, centres, road)


def _scenes(table: pl.DataFrame, name: str, lanes: _Lanes) -> list[Scene]:
    """A recording in windows."""
    table = (
        _known(table.lazy())
        .filter(pl.col("flags") & SPLIT == 0)
        .unique(["vehicle_id", "frame"], keep="first", maintain_order=True)
        .collect()
    )
    s = table["x_m"].to_numpy() - lanes.origin_m
    right = -table["y_m"].to_numpy()
    table = table.with_columns(
        pl.Series("s", s),
        pl.Series("d", rectify(s, right, lanes.grid, lanes.centres, lanes.road.lane_width_m)),
        pl.col("length_m").alias("length"),
        pl.col("width_m").fill_null(I80_WIDTH_M).alias("width"),
    )
    table = _surrounded(table).sort("vehicle_id", "frame")
    ids = np.sort(table["vehicle_id"].unique().to_numpy())
    held_out_from = int(ids[round((1.0 - HELD_OUT_SHARE) * (len(ids) - 1))])
    first = int(table["frame"].min())  # type: ignore[arg-type]
    window = (pl.col("frame") - first) // round(WINDOW_S / DT_S)
    return [
        assemble(f"{name} part {number}", part, lanes.road, held_out_from)
        for (number,), part in sorted(table.group_by(window, maintain_order=True), key=lambda group: group[0])
    ]


def lane_centres(
    name: str, s: np.ndarray, right: np.ndarray, lane: np.ndarray, vehicle: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Stations (G,) and centres (L, G) of lanes 1 to L, to the right of the site's reference, from n rows.

    Lanes are taken from 1 on as long as a lane is known along half of the road; where a lane has no vehicles it keeps
    its distance from the lane to its left.
    """
    grid = np.arange(0.5 * CELL_M, max(s.max(), CELL_M), CELL_M)
    rows = pl.DataFrame({"cell": (s // CELL_M).astype(int), "lane": lane, "right": right, "vehicle": vehicle})
    cells = (
        rows.group_by("lane", "cell")
        .agg(pl.col("right").median(), pl.col("vehicle").n_unique())
        .filter(pl.col("vehicle") >= CELL_SHARE * pl.col("vehicle").median())
    )
    centres: list[np.ndarray] = []
    for number in range(1, int(lane.max()) + 1):
        of_lane = cells.filter((pl.col("lane") == number) & (pl.col("cell") < len(grid))).sort("cell")
        if of_lane.height < LANE_COVERAGE * len(grid):
            break
        at, line = grid[of_lane["cell"].to_numpy()], of_lane["right"].to_numpy()
        if centres:
            apart = np.interp(grid, at, line - np.interp(at, grid, centres[-1]))
            if not SPACING_M[0] < np.median(apart) < SPACING_M[1]:
                break
            line = centres[-1] + np.clip(apart, *SPACING_M)
        else:
            line = np.interp(grid, at, line)
        padded = np.concatenate([line[:1], line, line[-1:]])
        centres.append((padded[:-2] + padded[1:-1] + padded[2:]) / 3.0)
    if not centres:
        raise DataError(
            f"recording {name}: no lane 1 along half of the road; lanes count from 1, the leftmost"
        )
    return grid, np.array(centres)


def _surrounded(table: pl.DataFrame) -> pl.DataFrame:
    """Whether each row's followers and leader were in the recorded area.

    followers_known, leader_known: as in the data pack, by the first and last vehicle of each lane and frame.
    """
    ends = table.group_by("frame", "lane").agg(
        pl.col("s").min().alias("first"), pl.col("s").max().alias("last")
    )
    for side in (-1, 0, 1):
        at = ends.with_columns((pl.col("lane") - side).alias("lane")).rename(
            {"first": f"first_{side}", "last": f"last_{side}"}
        )
        table = table.join(at, on=["frame", "lane"], how="left", maintain_order="left")
    lanes = int(table["lane"].max())  # type: ignore[arg-type]
    s, lane = pl.col("s"), pl.col("lane")
    left = (pl.col("first_-1") < s).fill_null(False) | (lane == 1)
    right = (pl.col("first_1") < s).fill_null(False) | (lane >= _main(table, lanes))
    return table.with_columns(
        (left & right & (pl.col("first_0") < s)).alias("followers_known"),
        (pl.col("last_0") > s).alias("leader_known"),
    )


def _main(table: pl.DataFrame, lanes: int) -> int:
    """The last lane that carries traffic all along: ramps have no followers to know."""
    rows = table["lane"].value_counts().sort("lane")
    busy = rows.filter(pl.col("count") > RAMP_SHARE * pl.col("count").median())["lane"]
    return int(busy.max()) if len(busy) else lanes  # type: ignore[arg-type]
