"""Parquet files that other projects made of NGSIM, told apart by their columns; one function a layout.

Each function returns tables (one a recording) with columns of the schema, in metres and seconds, and says which point
of the vehicle its source gives: x_front_m, x_rear_m or x_m (centre).
"""

import math
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import polars as pl
from polars import selectors

from policies.data.ngsim_flags import finish
from policies.data.ngsim_schema import METRES_PER_FOOT as FT
from policies.data.ngsim_schema import FormatError
from policies.data.ngsim_text import LARGEST_INTEGER
from policies.data.scenes import I80_LENGTH_EXCESS_M

CLASSES = {1: "motorcycle", 2: "car", 3: "truck"}
EPOCH_FROM_S = 1e8  # times beyond it count from 1970
# columns that say which row it is: never null, and numbers are whole but for times
KEYS = {"vehicle_id", "frame_id", "frame", "pair", "k", "event", "order", "Vehicle_ID", "Frame_ID"}
KEYS_NOT_WHOLE = {"chain", "t_s", "sim_time", "scene_id", "L-F_Pair", "pair_id"}


def read_pack(path: Path) -> tuple[str, Iterator[pl.DataFrame]]:
    """The layout's name and its recordings in SCHEMA."""
    try:
        table = pl.read_parquet(path)
    except (pl.exceptions.PolarsError, OSError) as error:
        raise FormatError(path, f"no readable Parquet file ({error})", "a Parquet file") from error
    for name, (needed, convert) in LAYOUTS.items():
        if set(needed) <= set(table.columns):
            table = table.with_columns(selectors.float().fill_nan(None))
            _check(path, table, needed)
            return name, convert(table)
    known = "; ".join(f"{name}: {', '.join(needed)}" for name, (needed, _) in LAYOUTS.items())
    raise FormatError(path, f"columns {', '.join(table.columns)}", f"the columns of one of {known}")


def _check(path: Path, table: pl.DataFrame, needed: dict[str, bool]) -> None:
    if table.height == 0:
        raise FormatError(path, "no rows", "at least one row")
    for name, numeric in needed.items():
        kind = table.schema[name]
        if numeric and not kind.is_numeric() and kind not in (pl.Categorical, pl.String):
            raise FormatError(path, f"values of type {kind}", "numbers", column=name)
        values = table[name]
        if numeric:
            values = values if kind.is_numeric() else values.cast(pl.String).cast(pl.Float64, strict=False)
            bad = values.is_null() & table[name].is_not_null() | values.is_infinite()
            if name in KEYS:
                bad = bad | (values != values.floor()) | (values.abs() > LARGEST_INTEGER)
        else:
            bad = pl.Series([False] * table.height)
        if name in KEYS | KEYS_NOT_WHOLE:
            bad = bad | values.is_null()
        bad = bad.fill_null(False)
        if bad.any():
            row = int(bad.arg_true()[0])
            wanted = "a whole number" if name in KEYS else "a value"
            raise FormatError(path, repr(table[name][row]), wanted, line=row + 1, column=name)


def _numbers(table: pl.DataFrame, *names: str) -> pl.DataFrame:
    """Categorical or text columns as numbers."""
    return table.with_columns(pl.col(n).cast(pl.String).cast(pl.Float64).cast(pl.Int64) for n in names)


def _of_one(source: str, recording: str) -> Iterator[pl.Expr]:
    """The first columns of a source that is one recording."""
    yield pl.lit(source).alias("source")
    yield pl.lit(recording).alias("recording")
    yield pl.col("vehicle_id")


def _coifman(t: pl.DataFrame) -> Iterator[pl.DataFrame]:
    yield finish(
        t.select(
            *_of_one("coifman", "i80-cam6-0400-0415"),
            pl.col("frame_id").alias("frame"),
            (pl.col("local_y_ft") * FT).alias("x_rear_m"),
            pl.col("lane_id").alias("lane"),
            (pl.col("v_vel_ftps") * FT).alias("speed_mps"),
            (pl.col("v_acc_ftps2") * FT).alias("accel_mps2"),
            _none_if_zero("preceding").alias("preceding_id"),
            _none_if_zero("following").alias("following_id"),
        )
    )


def _perl(t: pl.DataFrame) -> Iterator[pl.DataFrame]:
    t = t.with_columns(pl.col("t_s").min().over("chain").alias("_start"))
    # a vehicle without a number gets minus its place in the chain
    number = pl.when(pl.col("vehicle_id") > 0).then("vehicle_id").otherwise(-pl.col("order"))
    t = t.select(
        pl.lit("perl").alias("source"),
        ("i80-chain-" + pl.col("chain")).alias("recording"),
        number.alias("vehicle_id"),
        "order",
        ((pl.col("t_s") - pl.col("_start")) * 10.0).round().alias("frame"),
        pl.when(pl.col("t_s") > EPOCH_FROM_S).then("t_s").alias("epoch_s"),
        pl.col("y_m").alias("x_front_m"),
        pl.col("v_mps").alias("speed_mps"),
        pl.col("a_mps2").alias("accel_mps2"),
    )
    leader = t.select("recording", "frame", pl.col("order") + 1, pl.col("vehicle_id").alias("preceding_id"))
    key = ["recording", "frame", "order"]
    t = t.join(leader.unique(key), on=key, how="left")
    yield from _by_recording(t)


def _durraniu(t: pl.DataFrame) -> Iterator[pl.DataFrame]:
    t = _numbers(t, "vehicle_id", "v_class", "lane_id", "preceding")
    yield finish(
        t.select(
            *_of_one("durraniu", "i80-pairs-0400-0415"),
            pl.col("frame_id").round().alias("frame"),
            pl.col("local_y").alias("x_front_m"),
            (-pl.col("local_x")).alias("y_m"),
            pl.col("lane_id").alias("lane"),
            pl.col("v_vel").alias("speed_mps"),
            pl.col("v_acc").alias("accel_mps2"),
            pl.col("v_length").alias("length_m"),
            pl.col("v_width").alias("width_m"),
            class_name("v_class"),
            pl.col("preceding").alias("preceding_id"),
            # its headways are those of the raw recording, and its positions are reconstructed
            (pl.col("preceding_local_y") - pl.col("local_y")).alias("space_headway_m"),
            (pl.col("preceding_local_y") - pl.col("preceding_length") - pl.col("local_y")).alias("gap_m"),
        )
    )


def _jiang(t: pl.DataFrame) -> Iterator[pl.DataFrame]:
    both = [
        t.select(
            *_of_a_pair("jiang", "i80-0515-pair-" + pl.col("pair").cast(pl.String), number),
            (pl.col(f"{who}_pos_ft") * FT).alias("x_front_m"),
            (pl.col(f"{who}_v_ftps") * FT).alias("speed_mps"),
            (pl.col(f"{who}_a_ftps2") * FT).alias("accel_mps2"),
        )
        for number, who in ((1, "lead"), (2, "foll"))
    ]
    yield from _by_recording(pl.concat(both))


def _zhu(t: pl.DataFrame) -> Iterator[pl.DataFrame]:
    both = [
        t.select(
            *_of_a_pair("zhu", "i80-event-" + pl.col("event").cast(pl.String), number),
            pl.col(speed).alias("speed_mps"),
            (pl.col("spacing_m") if number == 2 else pl.lit(None, dtype=pl.Float64)).alias("gap_m"),
        )
        for number, speed in ((1, "lead_v_mps"), (2, "foll_v_mps"))
    ]
    yield from _by_recording(pl.concat(both))


def _smarts(t: pl.DataFrame) -> Iterator[pl.DataFrame]:
    yield finish(
        t.select(
            *_of_one("smarts", "i80-200-actors"),
            (pl.col("sim_time") * 10.0).round().alias("frame"),
            pl.col("position_x").alias("x_m"),
            pl.col("position_y").alias("y_m"),
            pl.col("lane_id").alias("lane"),
            # their 0 is +y, the road goes to +x
            (pl.col("heading_rad") - 1.5 * math.pi).alias("heading_rad"),
            pl.col("speed").alias("speed_mps"),
            pl.col("length").alias("length_m"),
            pl.col("width").alias("width_m"),
            class_name("type"),
        )
    )


def _vineet(t: pl.DataFrame) -> Iterator[pl.DataFrame]:
    t = t.select(
        pl.lit("vineet").alias("source"),
        ("i80-pair-" + pl.col("L-F_Pair")).alias("recording"),
        pl.col("Vehicle_ID").alias("vehicle_id"),
        pl.col("Frame_ID").alias("frame"),
        (pl.col("Global_Time") / 1000.0).alias("epoch_s"),
        pl.col("Local_Y").alias("x_front_m"),
        (-pl.col("Local_X")).alias("y_m"),
        pl.col("Lane_ID").alias("lane"),
        pl.col("v_Vel").alias("speed_mps"),
        pl.col("v_Acc").alias("accel_mps2"),
        pl.col("v_length").alias("length_m"),
        class_name("v_Class"),
        _none_if_zero("Preceding").alias("preceding_id"),
        _none_if_zero("Following").alias("following_id"),
        pl.col("Space_Headway").alias("space_headway_m"),
        (pl.col("Space_Headway") - pl.col("preceding_vehicle_length")).alias("gap_m"),
        pl.col("Time_Headway").alias("time_headway_s"),
    )
    yield from _by_recording(t)


def _i80(t: pl.DataFrame) -> Iterator[pl.DataFrame]:
    # the estimate is 1.1 m too long in the median (policies/data/scenes.py)
    length = (pl.col("length_est_m") - I80_LENGTH_EXCESS_M).clip(lower_bound=3.6)
    t = t.select(
        pl.lit("i80-scene").alias("source"),
        pl.col("scene_id").alias("recording"),
        "vehicle_id",
        "frame",
        pl.col("x_m").alias("x_front_m"),
        "y_m",
        "lane",
        "lane_offset_m",
        pl.col("heading_est_rad").alias("heading_rad"),
        pl.col("speed_est_mps").alias("speed_mps"),
        length.alias("length_m"),
    )
    yield from _by_recording(t, complete=True)


def _us101(t: pl.DataFrame) -> Iterator[pl.DataFrame]:
    turned = pl.col("heading_rad") - pl.col("lane_heading_rad")
    t = t.select(
        pl.lit("us101-scene").alias("source"),
        pl.col("scene_id").alias("recording"),
        "vehicle_id",
        "frame",
        pl.col("s_m").alias("x_m"),
        pl.col("d_m").alias("y_m"),
        "lane",
        "lane_offset_m",
        (turned - 2.0 * np.pi * (turned / (2.0 * np.pi)).round()).alias("heading_rad"),
        "speed_mps",
        "accel_mps2",
        "length_m",
        "width_m",
        pl.col("type").alias("vehicle_class"),
    )
    yield from _by_recording(t, complete=True)


def _by_recording(t: pl.DataFrame, *, complete: bool = False) -> Iterator[pl.DataFrame]:
    for _, recording in t.group_by("recording", maintain_order=True):
        yield finish(recording, complete=complete)


def _of_a_pair(source: str, recording: pl.Expr, number: int) -> tuple[pl.Expr, ...]:
    """What a pair's vehicle 1, which leads, and 2, which follows, have in every source; the other one's number."""
    return (
        pl.lit(source).alias("source"),
        recording.alias("recording"),
        pl.lit(number).alias("vehicle_id"),
        pl.col("k").alias("frame"),
        pl.lit(1 if number == 2 else None, dtype=pl.Int64).alias("preceding_id"),
        pl.lit(2 if number == 1 else None, dtype=pl.Int64).alias("following_id"),
    )


def class_name(column: str) -> pl.Expr:
    """NGSIM's class numbers as words, null for others."""
    return pl.col(column).cast(pl.Int64).replace_strict(CLASSES, default=None).alias("vehicle_class")


def _none_if_zero(column: str) -> pl.Expr:
    return pl.when(pl.col(column) != 0).then(column)


Convert = Callable[[pl.DataFrame], Iterator[pl.DataFrame]]


def _needs(numbers: str, words: str = "") -> dict[str, bool]:
    return dict.fromkeys(numbers.split(), True) | dict.fromkeys(words.split(), False)


# layout -> (columns it is known by, True where they must be numbers; how it is read)
LAYOUTS: dict[str, tuple[dict[str, bool], Convert]] = {
    "coifman": (
        _needs("vehicle_id frame_id local_y_ft v_vel_ftps v_acc_ftps2 lane_id preceding following"),
        _coifman,
    ),
    "perl": (_needs("t_s order vehicle_id y_m v_mps a_mps2", "chain"), _perl),
    "durraniu": (
        _needs(
            "vehicle_id frame_id local_x local_y v_length v_width v_class v_vel v_acc lane_id preceding space_headway "
            "time_headway preceding_local_y preceding_length"
        ),
        _durraniu,
    ),
    "jiang": (
        _needs("pair k lead_pos_ft lead_v_ftps lead_a_ftps2 foll_pos_ft foll_v_ftps foll_a_ftps2"),
        _jiang,
    ),
    "zhu": (_needs("event k spacing_m foll_v_mps lead_v_mps"), _zhu),
    "smarts": (
        _needs("vehicle_id sim_time position_x position_y heading_rad speed lane_id type length width"),
        _smarts,
    ),
    "vineet": (
        _needs(
            "Vehicle_ID Frame_ID Global_Time Local_X Local_Y v_length v_Class v_Vel v_Acc Lane_ID Preceding Following "
            "Space_Headway Time_Headway preceding_vehicle_length",
            "L-F_Pair",
        ),
        _vineet,
    ),
    "i80-scene": (
        _needs("vehicle_id frame x_m y_m lane lane_offset_m length_est_m", "scene_id"),
        _i80,
    ),
    "us101-scene": (
        _needs("vehicle_id frame s_m d_m heading_rad speed_mps accel_mps2 length_m width_m lane", "scene_id"),
        _us101,
    ),
}
