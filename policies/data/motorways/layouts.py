"""Which publisher's layout a file has, and its recordings."""

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import polars as pl

from policies.data.motorways import dlr, i24, level_x
from policies.data.motorways.planar import recordings
from policies.data.motorways.road_line import RoadLine
from policies.data.ngsim_schema import FormatError
from policies.data.scenes import DataError

HEADERS = (("dlr-highway", dlr.NEEDED), ("exid", level_x.EXID), ("highd", level_x.HIGHD))


@dataclass
class Read:
    """The recordings of a file.

    source: its layout, a key of ngsim_schema.LAYOUTS
    tables: in the schema, one a recording
    lines: the road of each site, filled as the tables are taken; none where a layout says lanes itself
    """

    source: str
    tables: Iterator[pl.DataFrame]
    lines: dict[str, RoadLine] = field(default_factory=dict)


def layout(path: Path) -> str | None:
    """The layout of a file by its beginning; None where it is none of these."""
    with open(path, "rb") as file:
        head = file.read(i24.HEAD_BYTES)
    if i24.is_i24(head):
        return "i24-motion"
    first = head.removeprefix(b"\xef\xbb\xbf").split(b"\n", 1)[0].decode("utf-8", "replace")
    names = {name.strip().strip('"') for name in first.split(",")}
    return next((found for found, needed in HEADERS if needed <= names), None)


def read(path: Path, source: str) -> Read:
    """The recordings of a file in the layout `source`. Raises FormatError, then or as tables are taken."""
    if source == "highd":
        return Read(source, level_x.highd(path))
    if source == "i24-motion":
        return Read(source, i24.i24(path))
    found = Read(source, iter(()))
    found.tables = _planar(path, found)
    return found


def _planar(path: Path, found: Read) -> Iterator[pl.DataFrame]:
    by = {
        "dlr-highway": (dlr.read, "a39"),
        "exid": (level_x.exid_rows, path.name.removesuffix(level_x.TRACKS)),
    }
    rows, location = by[found.source]
    try:
        for direction in recordings(rows(path), found.source, location):
            found.lines[direction.site] = direction.line
            yield direction.table
    except FormatError:
        raise
    except DataError as error:
        raise FormatError(path, str(error), "tracks along a motorway") from error
