"""The layouts of levelXdata: highD (straight motorways seen from above) and exiD (motorways with exits and entries).

A recording is three files beside each other: NN_tracks.csv, NN_tracksMeta.csv (classes) and NN_recordingMeta.csv (the
frame rate; in highD the lane markings). Columns as their publisher describes them (levelxdata.com):

highD: `x`, `y` are the upper left corner of the vehicle's box in metres, y downwards; `width` is its length along the
    road, `height` its width; `drivingDirection` 1 is towards smaller x, 2 towards larger.
exiD: `xCenter`, `yCenter` are the box's centre in metres, y upwards; `width` and `length` are what they are called.
"""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import polars as pl

from policies.data.motorways.given import beside, columns
from policies.data.motorways.tracks import at_ten_hertz
from policies.data.ngsim_flags import finish
from policies.data.ngsim_schema import FormatError

HIGHD = {"frame", "id", "x", "y", "width", "height", "xVelocity", "precedingId"}
EXID = {"trackId", "frame", "xCenter", "yCenter", "width", "length", "xVelocity", "yVelocity"}
TRACKS, VEHICLES, RECORDING = "_tracks.csv", "_tracksMeta.csv", "_recordingMeta.csv"
CLASSES = {"car": "car", "van": "car", "truck": "truck", "truck_bus": "truck", "bus": "truck", "trailer": "truck",
           "motorcycle": "motorcycle"}  # fmt: skip
SIDES = {1.0: ("upper", "upperLaneMarkings", -1.0), 2.0: ("lower", "lowerLaneMarkings", 1.0)}
FASTEST_MPS = 70.0


def exid_rows(path: Path) -> pl.DataFrame:
    """Rows of all vehicles of an exiD recording, as `planar.recordings` takes them."""
    table = columns(
        path, ("trackId", "frame", "xCenter", "yCenter", "width", "length", "xVelocity", "yVelocity")
    )
    kinds = columns(beside(path, TRACKS, VEHICLES), ("trackId",), ("class",))
    known = dict(zip(kinds["trackId"].to_list(), kinds["class"].to_list(), strict=True))
    rate = columns(beside(path, TRACKS, RECORDING), ("frameRate",))["frameRate"][0]
    return table.select(
        pl.col("trackId").cast(pl.Int64).alias("vehicle_id"),
        (pl.col("frame") / rate).alias("epoch_s"),
        pl.col("xCenter").alias("x_m"),
        pl.col("yCenter").alias("y_m"),
        (pl.col("xVelocity") ** 2 + pl.col("yVelocity") ** 2).sqrt().alias("speed_mps"),
        pl.col("length").alias("length_m"),
        pl.col("width").alias("width_m"),
        pl.lit(0.0).alias("interpolated"),
        pl.col("trackId")
        .replace_strict(known, default="")
        .replace_strict(CLASSES, default="")
        .alias("vehicle_class"),
    )


def highd(path: Path) -> Iterator[pl.DataFrame]:
    """The recordings of a highD file, one a carriageway, in the schema."""
    table = columns(path, ("frame", "id", "x", "y", "width", "height", "xVelocity"))
    kinds = columns(beside(path, TRACKS, VEHICLES), ("id", "drivingDirection"), ("class",))
    meta_path = beside(path, TRACKS, RECORDING)
    marking_names = tuple(name for _, name, _ in SIDES.values())
    meta = columns(meta_path, ("frameRate",), marking_names)
    table = table.join(kinds, on="id", how="inner")
    for direction, (side, name, forward) in SIDES.items():
        rows = table.filter(pl.col("drivingDirection") == direction)
        if not rows.height:
            continue
        try:
            lines = np.sort([float(y) for y in meta[name][0].split(";")])
        except ValueError:
            lines = np.zeros(0)
        if len(lines) < 2 or not np.isfinite(lines).all():
            raise FormatError(
                meta_path, repr(meta[name][0]), "two or more y of lines, with semicolons", 2, name
            )
        rows = rows.select(
            pl.col("id").cast(pl.Int64).alias("vehicle_id"),
            (pl.col("frame") / meta["frameRate"][0]).alias("t_s"),
            (forward * (pl.col("x") + 0.5 * pl.col("width"))).alias("x_m"),
            (-forward * (pl.col("y") + 0.5 * pl.col("height"))).alias("y_m"),
            pl.col("xVelocity").abs().alias("speed_mps"),
            pl.col("width").alias("length_m"),
            pl.col("height").alias("width_m"),
        )
        left = np.sort(-forward * lines)[::-1]  # the lines from the left, in the direction of travel
        tracks = at_ten_hertz(rows)
        lane = np.searchsorted(-left, -tracks["y_m"].to_numpy(), side="left")
        classes = {int(i): CLASSES.get(word.lower()) for i, word in kinds.select("id", "class").iter_rows()}
        tracks = tracks.with_columns(
            pl.lit("highd").alias("source"),
            pl.lit(f"{path.name.removesuffix(TRACKS)}-{side} 0").alias("recording"),
            pl.Series("lane", np.where((lane > 0) & (lane < len(left)), lane, 0)).replace(0, None),
            pl.col("vehicle_id").replace_strict(classes, return_dtype=pl.String).alias("vehicle_class"),
        )
        yield finish(tracks, complete=True, fastest_mps=FASTEST_MPS)
