"""I-24 MOTION (INCEPTION): a JSON array, or lines, of one document a vehicle.

Fields as their publisher describes them (github.com/yanb514/i24_database_api, README): `timestamp` in s since 1970;
`x_position`, `y_position` of the middle of the rear bumper in feet; `length`, `width` in feet, one value or one a time;
`direction` 1 eastbound, -1 westbound; y counts from the yellow line on the left, taken as a distance whatever its sign;
`coarse_vehicle_class` 0 to 5: sedan, midsize, van, pickup, semi-trailer, truck. Lanes are 12 feet wide.

Files hold hours: a document is brought to 10 Hz as it is read.
"""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl

from policies.data.motorways.tracks import at_ten_hertz
from policies.data.ngsim_flags import finish
from policies.data.ngsim_schema import DT_S, FormatError
from policies.data.ngsim_schema import METRES_PER_FOOT as FT

NEEDED = ("timestamp", "x_position", "y_position", "length", "width", "direction", "coarse_vehicle_class")
SIDES = {1: "eastbound", -1: "westbound"}
TRUCKS = (4, 5)
CLASSES = range(6)
LANE_FT = 12.0
MOST_LANES = 8
BLOCK = 1 << 20
SEPARATORS = " \t\r\n,["
FASTEST_MPS = 70.0
HEAD_BYTES = 1 << 16


def is_i24(head: bytes) -> bool:
    """Whether a file that begins so holds such documents."""
    return head.lstrip()[:1] in (b"[", b"{") and b'"x_position"' in head and b'"coarse_vehicle_class"' in head


def i24(path: Path) -> Iterator[pl.DataFrame]:
    """The recordings of a file, one a direction, in the schema."""
    tracks: dict[int, list[pl.DataFrame]] = {side: [] for side in SIDES}
    start: float | None = None
    for number, given in enumerate(_documents(path), start=1):
        side, rows, first = _track(path, number, given)
        start = first if start is None else start
        rows = rows.with_columns(pl.col("t_s") - start)
        tracks[side].append(at_ten_hertz(rows))
    if start is None:
        raise FormatError(path, "no document", "one JSON document a vehicle")
    for side, found in tracks.items():
        if not found:
            continue
        table = pl.concat(found)
        first_frame = int(table["frame"].min())  # type: ignore[arg-type]
        lane = (-table["y_m"] / (LANE_FT * FT)).floor().cast(pl.Int64) + 1
        yield finish(
            table.with_columns(
                pl.lit("i24-motion").alias("source"),
                pl.lit(f"i24-{SIDES[side]} {start:.0f}").alias("recording"),
                (pl.col("frame") - first_frame).alias("frame"),
                (start + pl.col("frame") * DT_S).alias("epoch_s"),
                lane.set(lane > MOST_LANES, None).alias("lane"),
                pl.when(pl.col("truck") > 0)
                .then(pl.lit("truck"))
                .otherwise(pl.lit("car"))
                .alias("vehicle_class"),
            ),
            complete=True,
            fastest_mps=FASTEST_MPS,
        )


def _track(path: Path, number: int, given: Any) -> tuple[int, pl.DataFrame, float]:
    """Direction, rows in the direction of travel in metres, and the first time of one document."""
    where = f"document {number}"
    if not isinstance(given, dict) or (missing := [name for name in NEEDED if name not in given]):
        told = f"no {missing[0]}" if isinstance(given, dict) else "something else than an object"
        raise FormatError(path, f"{told} in {where}", f"the fields {', '.join(NEEDED)}")
    side, kind = given["direction"], given["coarse_vehicle_class"]
    for name, value, wanted in (
        ("direction", side, tuple(SIDES)),
        ("coarse_vehicle_class", kind, tuple(CLASSES)),
    ):
        if value not in wanted:
            raise FormatError(path, f"{name} {value!r} in {where}", f"one of {', '.join(map(str, wanted))}")
    try:
        t, x, y = (np.asarray(given[name], dtype=np.float64) for name in NEEDED[:3])
        length, width = (float(np.median(np.asarray(given[name], dtype=np.float64))) for name in NEEDED[3:5])
        sound = t.ndim == 1 and len(t) > 0 and t.shape == x.shape == y.shape
        sound = sound and bool(np.isfinite(np.concatenate([t, x, y, [length, width]])).all())
    except (TypeError, ValueError):
        sound = False
    if not sound:
        raise FormatError(
            path, f"values in {where} that do not go together", "lists of numbers of one length, and sizes"
        )
    forward = float(side)
    ahead = forward * x * FT
    in_order = len(t) > 1 and bool((np.diff(t) > 0).all())
    speed = np.abs(np.gradient(ahead, t)) if in_order else np.full(len(t), np.nan)
    rows = pl.DataFrame(
        {
            "vehicle_id": np.full(len(t), number),
            "t_s": t,
            "x_rear_m": ahead,
            "y_m": -np.abs(y) * FT,
            "speed_mps": speed,
            "length_m": np.full(len(t), length * FT),
            "width_m": np.full(len(t), width * FT),
            "truck": np.full(len(t), float(kind in TRUCKS)),
        }
    )  # fmt: skip
    return side, rows, float(t[0])


def _documents(path: Path) -> Iterator[Any]:
    """The documents of a JSON array, or of lines, one at a time."""
    decoder, text = json.JSONDecoder(), ""
    with open(path, encoding="utf-8", errors="strict") as file:
        while True:
            text = text.lstrip(SEPARATORS)
            try:
                found, end = decoder.raw_decode(text)
            except json.JSONDecodeError as error:
                try:
                    more = file.read(max(BLOCK, len(text)))
                except UnicodeDecodeError as wrong:
                    raise FormatError(path, f"bytes that are no UTF-8 ({wrong})", "JSON") from wrong
                if more:
                    text += more
                    continue
                if text.strip(SEPARATORS + "]"):
                    raise FormatError(
                        path, f"JSON that ends or breaks ({error.msg})", "whole documents"
                    ) from error
                return
            yield found
            text = text[end:]
