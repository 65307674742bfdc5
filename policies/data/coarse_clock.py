"""Clock times that a spreadsheet has rounded: 1.11E+12 for every row of Global_Time.

They say nothing of when a row was, nor which of several periods it belongs to, whose frames and vehicles all count from
1. The order of the rows does, as long as the file has kept it: within a period vehicle numbers or frames only rise.
"""

from collections.abc import Iterator
from pathlib import Path

import polars as pl

from policies.data.ngsim_schema import FormatError

FEWEST_FRAMES = 20  # of fewer, nothing is said
FRAMES_A_TIME = 10.0  # one clock time for more frames than this, on average: it was rounded
MOST_PERIODS = 50


def coarse_locations(staged: pl.LazyFrame) -> dict[str, int]:
    """The locations with a rounded clock, and the different times that each has."""
    counts = (
        staged.filter(pl.col("global_time").is_not_null())
        .group_by("location")
        .agg(pl.col("global_time").n_unique().alias("times"), pl.col("frame").n_unique().alias("frames"))
        .collect()
        .sort("location")
    )
    return {
        row["location"]: row["times"]
        for row in counts.iter_rows(named=True)
        if row["frames"] >= FEWEST_FRAMES and row["frames"] > FRAMES_A_TIME * row["times"]
    }


def told(location: str, times: int) -> str:
    """The sentence about it."""
    return (
        f"{location}: Global_Time has {times} different value{'s' if times > 1 else ''}, as a spreadsheet rounds it "
        "(1.11E+12); periods are told apart by the order of the rows, and rows have no clock time. "
        "Export Global_Time in full to have it"
    )


def periods(path: Path, staged: pl.LazyFrame, location: str) -> Iterator[pl.LazyFrame]:
    """The rows of each period, without their clock times; FormatError where the order of rows does not tell them."""
    here = staged.filter(pl.col("location") == location).with_columns(
        pl.lit(None, dtype=pl.Int64).alias("global_time"), pl.lit(None, dtype=pl.Float64).alias("start_s")
    )
    keys = here.select("vehicle_id", "frame").collect()
    for column in ("vehicle_id", "frame"):
        began = (keys[column].diff() < 0).fill_null(False)
        number = began.cast(pl.Int64).cum_sum()
        if int(began.sum()) < MOST_PERIODS and not _repeats(keys.with_columns(number.alias("period"))):
            table = here.collect().with_columns(number.alias("period"))
            for (_,), rows in table.group_by(["period"], maintain_order=True):
                yield rows.drop("period").lazy()
            return
    if _repeats(keys.with_columns(pl.lit(0).alias("period"))):
        raise FormatError(
            path,
            f"a Global_Time that was rounded, in {location}, and rows in no order that tells periods apart",
            "Global_Time in full, as in 1113433136100, or rows in the order of the original file",
        )
    yield here


def _repeats(keys: pl.DataFrame) -> bool:
    """Whether a vehicle has two rows in a frame of one period."""
    return keys.select(pl.struct("period", "vehicle_id", "frame").n_unique()).item() < keys.height
