"""What can be said of a recording's rows once they are in metres: bumpers, neighbours, gaps, offsets and flags."""

import polars as pl

from policies.data.ngsim_schema import DT_S, FLAGS, SCHEMA

BACKWARD_M = 0.05
JUMP_M = 7.0  # a frame
SPEED_MPS = (0.0, 45.0)
ACCEL_MPS2 = (-9.0, 5.0)
CLIP_MPS2 = 3.41376  # 11.2 ft/s^2
CLIP_TOLERANCE_MPS2 = 0.006
LANES = (1, 8)
LENGTH_M = (0.8, 30.0)
WIDTH_M = (0.3, 3.5)
CLOCK_S = 0.05
OFFSET_CELL_M = 20.0
OFFSET_VEHICLES = 20  # a lane's centre is taken from a cell that at least so many vehicles passed


def finish(table: pl.DataFrame, complete: bool = False, fastest_mps: float = SPEED_MPS[1]) -> pl.DataFrame:
    """One recording in SCHEMA, sorted by vehicle and frame, from the columns that its source has (in metres).

    complete: every vehicle of the road is recorded, so that the vehicle ahead can be found where the source does not
        name it
    fastest_mps: a speed beyond it is flagged
    """
    if "interpolated" not in table.columns:
        table = table.with_columns(pl.lit(0.0).alias("interpolated"))
    missing = [pl.lit(None, dtype=kind).alias(n) for n, kind in SCHEMA.items() if n not in table.columns]
    table = table.with_columns(missing)
    table = table.with_columns(pl.col(n).cast(kind) for n, kind in SCHEMA.items()).with_columns(
        (pl.col("frame") * DT_S).alias("time_s")
    )
    table = _bumpers(table).sort("vehicle_id", "frame")
    if complete:
        table = _neighbours(table)
    table = _gaps(table)
    if table["lane_offset_m"].null_count() == table.height:
        table = _offsets(table)
    return _flagged(table, fastest_mps).select(list(SCHEMA))


def _bumpers(table: pl.DataFrame) -> pl.DataFrame:
    half = 0.5 * pl.col("length_m")
    front, centre, rear = pl.col("x_front_m"), pl.col("x_m"), pl.col("x_rear_m")
    return table.with_columns(
        pl.coalesce(front, centre + half, rear + 2.0 * half).alias("x_front_m"),
        pl.coalesce(centre, front - half, rear + half).alias("x_m"),
        pl.coalesce(rear, centre - half, front - 2.0 * half).alias("x_rear_m"),
    )


def _neighbours(table: pl.DataFrame) -> pl.DataFrame:
    """Fill preceding_id and following_id: the nearest ahead and behind in the same lane and frame."""
    key = ["frame", "lane"]
    ahead = table.sort(*key, "x_front_m").with_columns(
        pl.col("vehicle_id").shift(-1).over(key).alias("_ahead"),
        pl.col("vehicle_id").shift(1).over(key).alias("_behind"),
    )
    on_lane = pl.col("lane") > 0
    return (
        ahead.with_columns(
            pl.coalesce("preceding_id", pl.when(on_lane).then("_ahead")).alias("preceding_id"),
            pl.coalesce("following_id", pl.when(on_lane).then("_behind")).alias("following_id"),
        )
        .drop("_ahead", "_behind")
        .sort("vehicle_id", "frame")
    )


def _gaps(table: pl.DataFrame) -> pl.DataFrame:
    """Space headway, gap and time headway where the source lacks them and the vehicle ahead is recorded."""
    leader = (
        table.select(
            "frame",
            pl.col("vehicle_id").alias("preceding_id"),
            pl.col("x_front_m").alias("_front"),
            pl.col("x_rear_m").alias("_rear"),
            pl.col("length_m").alias("_length"),
        )
        .drop_nulls("preceding_id")
        .unique(["frame", "preceding_id"], keep="first", maintain_order=True)
    )
    table = table.join(leader, on=["frame", "preceding_id"], how="left", maintain_order="left")
    headway = pl.coalesce(
        "space_headway_m", pl.col("_front") - pl.col("x_front_m"), pl.col("_rear") - pl.col("x_rear_m")
    )
    table = table.with_columns(headway.alias("space_headway_m"))
    gap = pl.coalesce(
        "gap_m", pl.col("_rear") - pl.col("x_front_m"), pl.col("space_headway_m") - pl.col("_length")
    )
    moving = pl.when(pl.col("speed_mps") > 0.1).then(pl.col("space_headway_m") / pl.col("speed_mps"))
    return table.with_columns(
        gap.alias("gap_m"), pl.coalesce("time_headway_s", moving).alias("time_headway_s")
    ).drop("_front", "_rear", "_length")


def _offsets(table: pl.DataFrame) -> pl.DataFrame:
    """Lateral offset from the median y of the lane's rows, every 20 m along the road."""
    cell = ["lane", "_cell"]
    table = table.with_columns((pl.col("x_front_m") // OFFSET_CELL_M).alias("_cell"))
    centre = table.group_by(cell).agg(
        pl.col("y_m").median().alias("_centre"), pl.col("vehicle_id").n_unique().alias("_vehicles")
    )
    table = table.join(centre, on=cell, how="left", maintain_order="left")
    known = pl.col("_vehicles") >= OFFSET_VEHICLES
    return table.with_columns(
        pl.when(known).then(pl.col("y_m") - pl.col("_centre")).alias("lane_offset_m")
    ).drop("_cell", "_centre", "_vehicles")


def _flagged(table: pl.DataFrame, fastest_mps: float) -> pl.DataFrame:
    """`flags` of a table sorted by vehicle and frame."""
    point = pl.coalesce("x_front_m", "x_m", "x_rear_m")
    step, frames = (c.diff().over("vehicle_id") for c in (point, pl.col("frame")))
    apart = frames.clip(lower_bound=1)
    speed, accel, epoch = pl.col("speed_mps"), pl.col("accel_mps2"), pl.col("epoch_s")
    start = epoch - pl.col("time_s")
    tests = {
        "duplicate_frame": pl.len().over("vehicle_id", "frame") > 1,
        "frame_gap": frames > 1,
        "backward_step": step < -BACKWARD_M,
        "jump": step.abs() > JUMP_M * apart,
        "speed_limit": ~speed.is_between(SPEED_MPS[0], fastest_mps),
        "accel_limit": ~accel.is_between(*ACCEL_MPS2),
        "accel_clipped": (accel.abs() - CLIP_MPS2).abs() < CLIP_TOLERANCE_MPS2,
        "overlap": pl.col("gap_m") < 0.0,
        "bad_lane": ~pl.col("lane").is_between(*LANES),
        "bad_size": ~pl.col("length_m").is_between(*LENGTH_M) | ~pl.col("width_m").is_between(*WIDTH_M),
        "clock": (start - start.median()).abs() > CLOCK_S,
        "interpolated": pl.col("interpolated") > 0.0,
    }
    bits = [
        test.fill_null(False).cast(pl.Int64) * FLAGS[name][0]  # type: ignore[attr-defined]
        for name, test in tests.items()
    ]
    return table.with_columns(pl.sum_horizontal(bits).alias("flags"))
