"""DLR's traffic data of the motorway A39 (DLR Highway Traffic dataset, DOI 10.5281/zenodo.14012005).

Tables `trajectories_*.csv`: a row for each vehicle every 0.05 s; UTM positions of the box's centre and speeds in m and
m/s; `yaw` in degrees; sizes; a probability for each class, one value a vehicle; `interpolated` where the source filled
a row in. Its licence must be checked before weights that were made from it are passed on.
"""

from pathlib import Path

import polars as pl

from policies.data.motorways.given import columns
from policies.data.ngsim_schema import FormatError

CLASSES = {
    "pedestrian": "",
    "bicycle": "",
    "motorbike": "motorcycle",
    "car": "car",
    "van": "car",
    "truck": "truck",
}
NUMBERS = (
    "center_easting", "center_northing", "velocity_magnitude", "dimension_length", "dimension_width", "interpolated",
    *(f"classifications_{name}" for name in CLASSES),
)  # fmt: skip
NEEDED = {"timestamp", "id", *NUMBERS}


def read(path: Path) -> pl.DataFrame:
    """Rows of all vehicles, as `planar.recordings` takes them."""
    table = columns(path, NUMBERS, ("timestamp", "id"))
    at = table["timestamp"].str.to_datetime("%Y-%m-%d %H:%M:%S%.f%z", strict=False, time_unit="us")
    number = table["id"].cast(pl.Int64, strict=False)
    for name, values, wanted in (
        ("timestamp", at, "a time such as 2024-10-07 06:00:00.05+00:00"),
        ("id", number, "a whole number"),
    ):
        if values.null_count():
            row = int(values.is_null().arg_max() or 0)
            raise FormatError(path, repr(table[name][row]), wanted, row + 2, name)
    likely = pl.concat_list(f"classifications_{name}" for name in CLASSES).list.arg_max()
    kinds = dict(enumerate(CLASSES.values()))
    return table.select(
        number.alias("vehicle_id"),
        (at.dt.epoch("us") / 1e6).alias("epoch_s"),
        pl.col("center_easting").alias("x_m"),
        pl.col("center_northing").alias("y_m"),
        pl.col("velocity_magnitude").alias("speed_mps"),
        pl.col("dimension_length").alias("length_m"),
        pl.col("dimension_width").alias("width_m"),
        "interpolated",
        likely.replace_strict(kinds, return_dtype=pl.String).alias("vehicle_class"),
    )
