"""NGSIM's text and CSV files, read block by block into plain columns in the file's own units.

A block (16 MiB of whole lines) is parsed by polars. A block that polars does not take as it is goes through a slow
line-by-line reader, which either finds the fault (FormatError with file, line, column) or reads the lines itself: blank
lines, odd white space.
"""

import csv
import io
import re
from collections.abc import Callable, Iterator
from pathlib import Path

import polars as pl

from policies.data.ngsim_schema import FormatError

BLOCK_BYTES = 1 << 24
LONGEST_LINE = 1 << 16
LARGEST_INTEGER = 9e15  # whole numbers beyond it are not exact as floats
LARGEST = 1e12

# Columns in the file's units, in the order of the official text file.
COLUMNS = (
    "vehicle_id", "frame", "total_frames", "global_time", "local_x", "local_y", "global_x", "global_y", "length",
    "width", "class", "speed", "accel", "lane", "preceding", "following", "space_headway", "time_headway",
)  # fmt: skip
INTEGERS = {
    "vehicle_id", "frame", "total_frames", "global_time", "class", "lane", "preceding", "following",
}  # fmt: skip
# Names in the header of the portal's export and of the official per-period CSV files, in lower case.
HEADER = {
    "vehicle_id": "vehicle_id",
    "frame_id": "frame",
    "total_frames": "total_frames",
    "global_time": "global_time",
    "local_x": "local_x",
    "local_y": "local_y",
    "global_x": "global_x",
    "global_y": "global_y",
    "v_length": "length",
    "v_width": "width",
    "v_class": "class",
    "v_vel": "speed",
    "v_acc": "accel",
    "lane_id": "lane",
    "preceding": "preceding",
    "following": "following",
    "preceeding": "preceding",  # as older exports spell it
    "space_headway": "space_headway",
    "space_hdwy": "space_headway",
    "time_headway": "time_headway",
    "time_hdwy": "time_headway",
    "location": "location",
}
NEEDED = ("vehicle_id", "frame", "local_x", "local_y", "speed", "lane")
_NUMBER = re.compile(r"[+-]?(\d{1,3}(,\d{3})+|\d+)?(\.\d*)?([eE][+-]?\d{1,3})?")
_GROUPED = r"^[+-]?\d{1,3}(,\d{3})+(\.\d*)?$"
_LOCATION = r"^[A-Za-z0-9][A-Za-z0-9 ._-]{0,39}$"


def read_text(path: Path, block_bytes: int = BLOCK_BYTES) -> Iterator[pl.DataFrame]:
    """Blocks of the official 18-column file: COLUMNS as float64, in the file's units."""
    found = False
    for first_line, block in _blocks(path, block_bytes):
        table = _fast_text(block)
        if table is None:
            table = _slow(path, block, first_line, list(COLUMNS), _tokens_text)
        if table.height:
            found = True
            yield table
    if not found:
        raise FormatError(path, "no rows", "lines of 18 numbers")


def read_csv(path: Path, block_bytes: int = BLOCK_BYTES) -> Iterator[pl.DataFrame]:
    """Blocks of a CSV export: the COLUMNS that it has as float64 (empty fields null), and `location` where it is."""
    names: list[str] | None = None
    found = False
    for first_line, block in _blocks(path, block_bytes):
        if names is None:
            head, _, block = block.partition(b"\n")
            names = header(path, head)
            first_line += 1
        table = _fast_csv(block, names) if block else None
        if table is None:
            table = _slow(path, block, first_line, names, _tokens_csv)
        if table.height:
            found = True
            yield table
    if not found:
        raise FormatError(path, "no rows", "a header and rows of a CSV export")


def header(path: Path, line: bytes) -> list[str]:
    """Our names of a CSV header's columns, "" for those not used; FormatError where needed ones are missing."""
    try:
        given = next(csv.reader([line.decode("utf-8").lstrip("\ufeff").rstrip("\r")], strict=True), [])
    except (csv.Error, UnicodeDecodeError) as error:
        raise FormatError(path, f"a header that is not CSV ({error})", "names with commas", 1) from error
    names = [HEADER.get(plain_name(name), "") for name in given]
    for needed in NEEDED:
        if needed not in names:
            label = next(k for k, v in HEADER.items() if v == needed)
            raise FormatError(path, f"a header {_short(given)}", f"a column named {label}", 1)
    for i, name in enumerate(names):
        if name and name in names[:i]:
            raise FormatError(path, f"{given[i]!r} twice", "each column once", 1, str(i + 1))
    return names


def is_csv(path: Path) -> bool:
    """Whether the first line has a vehicle_id header."""
    with open(path, "rb") as file:
        head = file.readline(LONGEST_LINE).lower()
    return b"," in head and (b"vehicle_id" in head or b"vehicle id" in head)


def plain_name(name: str) -> str:
    """A column's name as HEADER has it, whether written with blanks or underscores."""
    return name.strip().lower().replace(" ", "_")


def _blocks(path: Path, size: int) -> Iterator[tuple[int, bytes]]:
    """(number of the first line, whole lines) of a file."""
    line, rest = 1, b""
    with open(path, "rb") as file:
        while chunk := file.read(size):
            if line == 1 and not rest:
                chunk = chunk.removeprefix(b"\xef\xbb\xbf")
            data = rest + chunk
            cut = data.rfind(b"\n") + 1
            rest = data[cut:]
            if len(rest) > max(LONGEST_LINE, size):
                number = line + data.count(b"\n")
                raise FormatError(path, f"a line of more than {len(rest)} bytes", "lines of text", number)
            if cut:
                yield line, data[:cut]
                line += data.count(b"\n")
    if rest:
        yield line, rest


def _fast_text(block: bytes) -> pl.DataFrame | None:
    block = block.replace(b"\t", b" ").replace(b"\r\n", b"\n")
    while b"  " in block:
        block = block.replace(b"  ", b" ")
    block = block.replace(b"\n ", b"\n").replace(b" \n", b"\n").strip(b" ")
    try:
        table = pl.read_csv(
            block,
            has_header=False,
            separator=" ",
            quote_char=None,
            schema=dict.fromkeys(COLUMNS, pl.Float64),
        )
    except pl.exceptions.PolarsError:
        return None
    lines = block.count(b"\n") + (not block.endswith(b"\n"))
    complete = table.height == lines and not any(table.null_count().row(0))
    return table if complete and _sound(table) else None


def _fast_csv(block: bytes, names: list[str]) -> pl.DataFrame | None:
    block = block.replace(b"\r\n", b"\n")
    labels = [name or f"_{i}" for i, name in enumerate(names)]
    try:
        table = pl.read_csv(block, has_header=False, schema=dict.fromkeys(labels, pl.String))
    except pl.exceptions.PolarsError:
        return None
    lines = block.count(b"\n") + (not block.endswith(b"\n"))
    if table.height != lines or table[labels[-1]].null_count():
        return None
    columns = []
    for name in filter(None, names):
        text = table[name].str.strip_chars()
        if name == "location":
            if text.null_count() or not text.str.contains(_LOCATION).all():
                return None
            columns.append(text)
            continue
        text = text.set(text == "", None)
        commas = text.str.contains(",", literal=True)
        if commas.any():
            if not text.filter(commas).str.contains(_GROUPED).all():
                return None
            text = text.str.replace_all(",", "", literal=True)
        value = text.cast(pl.Float64, strict=False)
        if value.null_count() > (0 if name in NEEDED else text.null_count()):
            return None
        columns.append(value)
    out = pl.DataFrame(columns)
    return out if _sound(out) else None


def _sound(table: pl.DataFrame) -> bool:
    """Whether all values are finite and of a sensible size, and whole where they must be."""
    tests = []
    for name in table.columns:
        if name == "location":
            continue
        c = pl.col(name)
        test = c.is_finite() & (c.abs() < (LARGEST_INTEGER if name in INTEGERS else LARGEST))
        tests.append(((test & (c == c.floor())) if name in INTEGERS else test).all().alias(name))
    return all(table.select(tests).row(0))


def _tokens_text(line: str) -> list[str]:
    return line.split()


def _tokens_csv(line: str) -> list[str]:
    return next(csv.reader(io.StringIO(line), strict=True), [])


def _slow(
    path: Path, block: bytes, first_line: int, names: list[str], tokens: Callable[[str], list[str]]
) -> pl.DataFrame:
    rows: list[list[float | str | None]] = []
    used = [(i, name) for i, name in enumerate(names) if name]
    for offset, raw in enumerate(block.split(b"\n")):
        number = first_line + offset
        try:
            line = raw.decode("utf-8").strip()
        except UnicodeDecodeError as error:
            raise FormatError(
                path, f"byte {raw[error.start]:#04x}", "text in UTF-8", number, f"byte {error.start + 1}"
            ) from error
        if not line:
            continue
        try:
            given = tokens(line)
        except csv.Error as error:
            raise FormatError(path, f"{_short(line)} ({error})", "a CSV row", number) from error
        if len(given) != len(names):
            raise FormatError(path, f"{len(given)} values", f"{len(names)} values", number)
        rows.append([_value(path, number, i, name, given[i].strip()) for i, name in used])
    schema = {name: pl.String if name == "location" else pl.Float64 for _, name in used}
    return pl.DataFrame(rows, schema=schema, orient="row")


def _value(path: Path, line: int, index: int, name: str, text: str) -> float | str | None:
    column = f"{index + 1} ({name})"
    if name == "location":
        if not re.fullmatch(_LOCATION[1:-1], text):
            raise FormatError(path, _short(text), "a location such as i-80", line, column)
        return text
    if not text:
        if name not in NEEDED:
            return None
        raise FormatError(path, "nothing", "a number", line, column)
    kind = "a whole number" if name in INTEGERS else "a number"
    if not re.search(r"\d", text) or not _NUMBER.fullmatch(text) or not text.isascii():
        raise FormatError(path, _short(text), kind, line, column)
    value = float(text.replace(",", ""))
    if not abs(value) < (LARGEST_INTEGER if name in INTEGERS else LARGEST):
        raise FormatError(path, _short(text), f"{kind} of a sensible size", line, column)
    if name in INTEGERS and value != int(value):
        raise FormatError(path, _short(text), kind, line, column)
    return value


def _short(value: object) -> str:
    text = repr(value)
    return text if len(text) <= 80 else f"{text[:80]}..."
