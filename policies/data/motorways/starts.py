"""How vehicles stand around a car in the right lane of a motorway in free flow: Beta distributions fitted to a table.

Of every car in the right lane, once a second: the distance to the truck ahead of it, to the vehicle behind it, and to
the nearest vehicles of the left lane ahead and behind; and the speeds of each of them. Values outside BOUNDS are left
out. Values are taken as independent, which neighbours' speeds are not.
"""

from dataclasses import dataclass

import numpy as np
import polars as pl

from policies.columns import Values
from policies.data.ngsim_flags import SPEED_MPS
from policies.data.scenes import DataError
from policies.data.start_fit import BetaFit, fit_beta

EVERY_FRAMES = 10
ACROSS_FRAMES = 5  # headings are taken over so many frames before and after
RESAMPLES = 20  # of the intervals, which are not told here
AHEAD_M, BESIDE_M = (40.0, 240.0), (15.0, 215.0)
OFFSET_M, HEADING_DEG = (-0.4, 0.4), (-1.5, 1.5)
SPEED_BOUNDS_MPS = (SPEED_MPS[0], 70.0)
ROLES = ("truck ahead", "behind", "left, ahead", "left, behind")
TRUCK = "truck"


@dataclass(frozen=True)
class MotorwayStarts:
    """The fits.

    distance_m, speed_mps: by role (ROLES), distances positive; speed_mps of "ego", too
    lane_offset_m, heading_deg: of all vehicles in the lanes
    truck_m: median length and width of the trucks ahead
    lanes: of the carriageway
    """

    distance_m: dict[str, BetaFit]
    speed_mps: dict[str, BetaFit]
    lane_offset_m: BetaFit
    heading_deg: BetaFit
    truck_m: tuple[float, float]
    lanes: int


def motorway_starts(table: pl.DataFrame) -> MotorwayStarts:
    """The starts of one recording in the schema. Raises DataError where too few vehicles are seen in a role."""
    lanes = int(table["lane"].fill_null(0).max())  # type: ignore[arg-type]
    if lanes < 2:
        raise DataError("a motorway's starts need two lanes or more; one was found")
    k = ACROSS_FRAMES
    way = [
        pl.col(c).shift(-k).over("vehicle_id") - pl.col(c).shift(k).over("vehicle_id") for c in ("x_m", "y_m")
    ]
    rows = (
        table.sort("vehicle_id", "frame")
        .with_columns(
            pl.arctan2(way[1], way[0]).degrees().alias("heading"),
            pl.col("lane_offset_m").fill_null(pl.col("y_m") - pl.col("y_m").median().over("lane")),
        )
        .filter((pl.col("frame") % EVERY_FRAMES == 0) & pl.col("lane").is_not_null() & (pl.col("lane") > 0))
        .select("frame", "vehicle_id", "lane", "x_m", "speed_mps", "vehicle_class", "length_m", "width_m",
                "lane_offset_m", "heading")
    )  # fmt: skip
    ego = rows.filter((pl.col("lane") == lanes) & (pl.col("vehicle_class") != TRUCK))
    right, left = (rows.filter(pl.col("lane") == lane) for lane in (lanes, lanes - 1))
    seen = {
        "truck ahead": _nearest(ego, right, 1.0, AHEAD_M).filter(pl.col("vehicle_class") == TRUCK),
        "behind": _nearest(ego, right, -1.0, AHEAD_M),
        "left, ahead": _nearest(ego, left, 1.0, BESIDE_M),
        "left, behind": _nearest(ego, left, -1.0, BESIDE_M),
    }
    for role, found in seen.items():
        if found["vehicle_id"].n_unique() < 2:
            raise DataError(f"fewer than two vehicles were seen as {role!r}; a longer recording is needed")
    trucks = seen["truck ahead"].unique("vehicle_id")
    bounds = {role: AHEAD_M if role in ROLES[:2] else BESIDE_M for role in ROLES}
    speeds = {"ego": ego} | seen
    return MotorwayStarts(
        {role: _fit(found, "apart", bounds[role]) for role, found in seen.items()},
        {role: _fit(found, "speed_mps", SPEED_BOUNDS_MPS) for role, found in speeds.items()},
        _fit(rows, "lane_offset_m", OFFSET_M),
        _fit(rows, "heading", HEADING_DEG),
        (float(trucks["length_m"].median()), float(trucks["width_m"].median())),  # type: ignore[arg-type]
        lanes,
    )


def _nearest(
    ego: pl.DataFrame, others: pl.DataFrame, ahead: float, bounds: tuple[float, float]
) -> pl.DataFrame:
    """The nearest of `others` on one side of each ego at the same time, and how far `apart`, where within bounds."""
    pairs = ego.select("frame", pl.col("vehicle_id").alias("ego"), pl.col("x_m").alias("from")).join(
        others, on="frame"
    )
    return (
        pairs.with_columns((ahead * (pl.col("x_m") - pl.col("from"))).alias("apart"))
        .filter((pl.col("apart") > 0.0) & (pl.col("ego") != pl.col("vehicle_id")))
        .sort("apart")
        .unique(["frame", "ego"], keep="first", maintain_order=True)
        .filter(pl.col("apart").is_between(*bounds))
    )


def _fit(rows: pl.DataFrame, name: str, bounds: tuple[float, float]) -> BetaFit:
    known = rows.filter(pl.col(name).is_not_null() & pl.col(name).is_between(*bounds))
    if known["vehicle_id"].n_unique() < 2:
        raise DataError(f"{name}: fewer than two vehicles lie within {bounds[0]:g} to {bounds[1]:g}")
    return fit_beta(
        Values(known[name].to_numpy().astype(np.float64), known["vehicle_id"].to_numpy()), bounds, RESAMPLES
    )
