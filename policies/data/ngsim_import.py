"""Recordings in any layout we know -> one Parquet file in the schema (ngsim_schema.py), and a report beside it.

Text and CSV are staged block by block as Parquet, then finished one recording at a time: memory holds a block or
a recording (15 minutes), not the file. A recording is where frame numbers share one clock: rows whose
global time - 0.1 s x frame agree within a minute.
"""

import json
import os
import shutil
import tempfile
from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl

from policies.data import motorways
from policies.data.coarse_clock import coarse_locations, periods, told
from policies.data.file_kinds import refuse_foreign, unpacked
from policies.data.motorways.road_line import RoadLine
from policies.data.ngsim_flags import finish
from policies.data.ngsim_pack import class_name, read_pack
from policies.data.ngsim_schema import DT_S, FLAGS, METRES_PER_FOOT, SCHEMA, FormatError
from policies.data.ngsim_text import COLUMNS, INTEGERS, is_csv, read_csv, read_text

SAME_RECORDING_S = 60.0
MOST_RECORDINGS = 200  # of a location; a file with more has no clock to go by, and stays one recording
NO_HEADWAY = 9999.0  # NGSIM writes 9999.99 (and 0) for "none"
FEET_FROM = 8.0  # cars' median length: 14.5 in feet, 4.4 in metres
ROAD_EVERY_M = 10
PERCENTILES = (1, 5, 25, 50, 75, 95, 99)


def import_file(path: Path, out: Path, units: str = "auto") -> dict[str, Any]:
    """Write out/NAME.parquet and out/NAME.json; the report that the latter holds.

    units: of text and CSV files, "feet", "metres" or "auto" (told by the cars' lengths; feet where no car has one)

    Raises FormatError for a file in no known layout, or malformed: nothing is written then.
    """
    if not path.is_file():
        raise FormatError(path, "no such file", "a text, CSV or Parquet file")
    name = path.name.removesuffix(".gz").removesuffix(".zip").rpartition(".")[0] or path.stem
    out.mkdir(parents=True, exist_ok=True)
    work = Path(tempfile.mkdtemp(prefix=".import-", dir=out))
    try:
        try:
            notes: list[str] = []
            lines: dict[str, RoadLine] = {}
            source, detected, recordings = _recordings(unpacked(path, work), work, units, notes, lines)
            summaries = [_stage(table, work / "done", i) for i, table in enumerate(recordings)]
        except FormatError as error:  # of a file that was unpacked, by the name it was given by
            given = path if Path(str(error.path)).is_relative_to(work) else error.path
            raise FormatError(given, error.found, error.expected, error.line, error.column) from error
        except (pl.exceptions.PolarsError, OSError) as error:
            raise FormatError(path, f"a file that cannot be read ({error})", "a readable file") from error
        whole = pl.scan_parquet(work / "done" / "*.parquet")
        report = _report(path, source, detected, whole, summaries) | {"notes": notes, "roads": _roads(lines)}
        whole.sink_parquet(work / "table.parquet", compression="zstd")
        (work / "report.json").write_text(json.dumps(report, indent=2) + "\n", encoding="utf-8")
        os.replace(work / "table.parquet", out / f"{name}.parquet")
        os.replace(work / "report.json", out / f"{name}.json")
    finally:
        shutil.rmtree(work, ignore_errors=True)
    return report


def _recordings(
    path: Path, work: Path, units: str, notes: list[str], lines: dict[str, RoadLine]
) -> tuple[str, str, Iterator[pl.DataFrame]]:
    """The layout, the units found, and finished tables, one a recording.

    What there is to say is added to `notes`; roads in the plane, as the tables are taken, to `lines`.
    """
    with open(path, "rb") as file:
        start = file.read(4)
    if start == b"PAR1" or path.suffix == ".parquet":
        source, tables = read_pack(path)
        feet = source in ("coifman", "jiang")
        return source, "feet" if feet else "metres", tables
    published = motorways.layout(path)
    if published is not None:
        read = motorways.read(path, published)
        read.lines = lines
        return published, "feet" if published == "i24-motion" else "metres", read.tables
    as_csv = is_csv(path)
    source = "ngsim-csv" if as_csv else "ngsim-text"
    if not as_csv:
        refuse_foreign(path)
    raw = work / "raw"
    raw.mkdir()
    for i, block in enumerate(read_csv(path) if as_csv else read_text(path)):
        _plain(block, path.stem).write_parquet(raw / f"{i:06d}.parquet", compression="lz4")
    staged = pl.scan_parquet(raw / "*.parquet")
    detected = _units(staged) if units == "auto" else units
    return source, detected, _split(path, staged, source, detected, notes)


def _roads(lines: dict[str, RoadLine]) -> dict[str, Any]:
    """The roads in the plane, by site, every ROAD_EVERY_M: what `tailroad data motorway` builds networks from."""
    found = {}
    for site, line in lines.items():
        x, y, heading, _ = (np.round(values[::ROAD_EVERY_M], 4).tolist() for values in line.curve)
        lanes = np.round(line.lanes_m, 3).tolist()
        found[site] = {"x_m": x, "y_m": y, "heading_rad": heading, "lanes_left_m": lanes}
    return found


def _plain(block: pl.DataFrame, location: str) -> pl.DataFrame:
    """A block with all COLUMNS and a location, whole numbers as such, and the clock time of frame 0."""
    missing = [pl.lit(None, dtype=pl.Float64).alias(name) for name in COLUMNS if name not in block.columns]
    if "location" not in block.columns:
        missing.append(pl.lit(location).alias("location"))
    return block.with_columns(missing).select(
        *(pl.col(name).cast(pl.Int64 if name in INTEGERS else pl.Float64) for name in COLUMNS),
        "location",
        (pl.col("global_time") / 1000.0 - pl.col("frame") * DT_S).alias("start_s"),
    )


def _units(staged: pl.LazyFrame) -> str:
    length = pl.col("length").filter(pl.col("class") == 2).median()
    median = staged.select(length).collect().item()
    return "metres" if median is not None and median < FEET_FROM else "feet"


def _split(
    path: Path, staged: pl.LazyFrame, source: str, units: str, notes: list[str]
) -> Iterator[pl.DataFrame]:
    coarse = coarse_locations(staged)
    for location, times in coarse.items():
        notes.append(told(location, times))
        for number, rows in enumerate(periods(path, staged, location)):
            yield _metres(rows, source, units, f"{location} period {number + 1}")
    staged = staged.filter(~pl.col("location").is_in(list(coarse)))
    starts = staged.select("location", "start_s").unique().collect().sort("location", "start_s")
    for (location,), group in starts.group_by(["location"], maintain_order=True):
        here = pl.col("location") == location
        if group["start_s"].null_count():
            yield _metres(staged.filter(here & pl.col("start_s").is_null()), source, units, str(location))
        known = group["start_s"].drop_nulls().to_numpy()
        breaks = np.flatnonzero(np.diff(known) > SAME_RECORDING_S) + 1
        for part in np.split(known, breaks if len(breaks) < MOST_RECORDINGS else []):
            if len(part):
                rows = staged.filter(here & pl.col("start_s").is_between(part[0], part[-1]))
                yield _metres(rows, source, units, f"{location} {_clock(float(np.median(part)))}")


def _clock(start_s: float) -> str:
    """When frame 0 was, to the second; the plain number where that is no date."""
    try:
        return datetime.fromtimestamp(start_s, UTC).strftime("%Y-%m-%dT%H:%M:%SZ")
    except (ValueError, OverflowError, OSError):
        return f"{start_s:.0f}"


def _metres(rows: pl.LazyFrame, source: str, units: str, recording: str) -> pl.DataFrame:
    k = METRES_PER_FOOT if units == "feet" else 1.0

    def headway(name: str) -> pl.Expr:
        value = pl.col(name)
        return pl.when((value > 0.0) & (value < NO_HEADWAY)).then(value)

    def other(name: str) -> pl.Expr:
        return pl.when(pl.col(name) != 0).then(name)

    return finish(
        rows.select(
            pl.lit(source).alias("source"),
            pl.lit(recording).alias("recording"),
            "vehicle_id",
            "frame",
            (pl.col("global_time") / 1000.0).alias("epoch_s"),
            (pl.col("local_y") * k).alias("x_front_m"),
            (pl.col("local_x") * -k).alias("y_m"),
            "lane",
            (pl.col("speed") * k).alias("speed_mps"),
            (pl.col("accel") * k).alias("accel_mps2"),
            (pl.col("length") * k).alias("length_m"),
            (pl.col("width") * k).alias("width_m"),
            class_name("class"),
            other("preceding").alias("preceding_id"),
            other("following").alias("following_id"),
            (headway("space_headway") * k).alias("space_headway_m"),
            headway("time_headway").alias("time_headway_s"),
        ).collect()
    )


def _stage(table: pl.DataFrame, folder: Path, number: int) -> dict[str, Any]:
    folder.mkdir(exist_ok=True)
    table.write_parquet(folder / f"{number:06d}.parquet", compression="lz4")
    lanes = table.group_by("lane").len().sort("lane").rows()
    return {
        "recording": table["recording"][0],
        "rows": table.height,
        "vehicles": table["vehicle_id"].n_unique(),
        "frames": table["frame"].n_unique(),
        "first_frame": table["frame"].min(),
        "last_frame": table["frame"].max(),
        "span_s": round((int(table["frame"].max()) - int(table["frame"].min())) * DT_S, 1),  # type: ignore[arg-type]
        "rows_by_lane": {str(lane) if lane is not None else "unknown": n for lane, n in lanes},
    }


def _report(
    path: Path, source: str, units: str, whole: pl.LazyFrame, recordings: list[dict[str, Any]]
) -> dict[str, Any]:
    flags = [((pl.col("flags") & bit) > 0).sum().alias(name) for name, (bit, _) in FLAGS.items()]
    counts = whole.select(*flags, (pl.col("flags") == 0).sum().alias("_clean")).collect().row(0, named=True)
    speed = whole.select("speed_mps").collect()["speed_mps"].drop_nulls()
    # polars' quantile of a column without values is null
    percentiles = {str(p): speed.quantile(p / 100.0, "linear") for p in PERCENTILES}
    known = whole.select(pl.all().count()).collect().row(0, named=True)
    rows_by_lane: dict[str, int] = {}
    for recording in recordings:
        for lane, n in recording["rows_by_lane"].items():
            rows_by_lane[lane] = rows_by_lane.get(lane, 0) + n
    return {
        "file": path.name,
        "source": source,
        "units_found": units,
        "rows": sum(r["rows"] for r in recordings),
        "rows_without_flag": counts.pop("_clean"),
        "vehicles": sum(r["vehicles"] for r in recordings),
        "frames": sum(r["frames"] for r in recordings),
        "span_s": round(sum(r["span_s"] for r in recordings), 1),
        "rows_by_lane": dict(sorted(rows_by_lane.items())),
        "speed_percentiles_mps": {
            k: None if v is None else round(float(v), 3) for k, v in percentiles.items()
        },
        "flagged_rows": counts,
        "columns_without_values": [name for name in SCHEMA if known[name] == 0],
        "recordings": recordings,
    }
