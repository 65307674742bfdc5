"""What kind of file a recording is: packed ones are unpacked, tables that are none of ours are named."""

import gzip
import shutil
import zipfile
import zlib
from pathlib import Path
from typing import IO

from policies.data.ngsim_schema import FormatError

LARGEST_BYTES = 64 << 30  # of an unpacked file
HEAD_BYTES = 1 << 16
TABLES = (".csv", ".txt", ".parquet", ".tsv")
OURS = (
    "NGSIM's CSV (columns Vehicle_ID, Frame_ID, Local_X, Local_Y, v_Vel, Lane_ID, separated by commas) or its text "
    "file of 18 numbers a line"
)
TEXT_COLUMNS = 18
DLR_TABLE = "trajectories_"  # the one of DLR's tables that holds vehicles
# what gives a table away, in lower case without blanks: names that its header must have, and what it is
KNOWN = (
    ({"xloc-kf", "yloc-kf"}, "a TGSIM table"),
    ({"xloc_kf", "yloc_kf"}, "a TGSIM table"),
    ({"timestep_time"}, "SUMO's output as a table"),
    ({"trackid", "xcenter", "ycenter"}, "a table of inD or rounD, or an exiD table without its speeds"),
    ({"track_id", "frame_id", "agent_type"}, "an INTERACTION table"),
    ({"timestamp_ms", "psi_rad"}, "an INTERACTION table"),
    ({"space_headway", "local_y"}, "a table like NGSIM's"),
)


def unpacked(path: Path, work: Path) -> Path:
    """The file itself, or the table that a zip or gz file holds, unpacked into `work`; FormatError without one."""
    with open(path, "rb") as file:
        start = file.read(4)
    try:
        if start[:2] == b"\x1f\x8b":
            with gzip.open(path) as packed:
                return _copied(path, packed, work / (path.stem if path.suffix == ".gz" else path.name))
        if start == b"PK\x03\x04":
            with zipfile.ZipFile(path) as archive:
                found = [
                    m for m in archive.infolist()
                    if Path(m.filename).suffix.lower() in TABLES and "__MACOSX" not in m.filename
                ]  # fmt: skip
                tracks = [m for m in found if Path(m.filename).name.startswith(DLR_TABLE)]
                found = tracks if len(tracks) == 1 else found
                if len(found) != 1:
                    names = ", ".join(m.filename for m in found[:5]) or "none"
                    kind = "a spreadsheet or other archive" if path.suffix.lower() != ".zip" else "a zip file"
                    raise FormatError(
                        path,
                        f"{kind} with {len(found)} tables ({names})",
                        "a zip file of one table: unpack it, or save the sheet as CSV",
                    )
                with archive.open(found[0]) as packed:
                    return _copied(path, packed, work / Path(found[0].filename).name)
    except (OSError, EOFError, zlib.error, zipfile.BadZipFile, RuntimeError, NotImplementedError) as error:
        raise FormatError(
            path, f"a packed file that cannot be unpacked ({error})", "a whole zip or gz file"
        ) from error
    return path


def _copied(path: Path, packed: IO[bytes] | gzip.GzipFile, out: Path) -> Path:
    written = 0
    with open(out, "wb") as file:
        while chunk := packed.read(1 << 20):
            written += len(chunk)
            if written > LARGEST_BYTES:
                raise FormatError(
                    path, f"more than {LARGEST_BYTES >> 30} GiB unpacked", "a smaller file: split it"
                )
            file.write(chunk)
    shutil.copystat(path, out)
    return out


def refuse_foreign(path: Path) -> None:
    """FormatError for text in no layout we read, by its beginning: what it is, the columns needed, the remedy."""
    with open(path, "rb") as file:
        head = file.read(HEAD_BYTES)
    if head[:2] in (b"\xff\xfe", b"\xfe\xff"):
        raise FormatError(path, "text in UTF-16", "text in UTF-8: save it as 'CSV UTF-8'")
    line = head.removeprefix(b"\xef\xbb\xbf").lstrip().split(b"\n", 1)[0].decode("utf-8", "replace").strip()
    if line.startswith("<"):
        raise FormatError(path, f"XML ({line[:60]!r})", f"{OURS}: convert it to such a table")
    if line.startswith(("{", "[")):
        raise FormatError(path, "JSON", f"{OURS}: convert it to such a table")
    for separator, word in ((";", "semicolons"), ("\t", "tabs"), (",", "")):
        fields = [field.strip().strip('"') for field in line.split(separator)]
        if len(fields) < 3:
            continue
        if all(_is_number(field) for field in fields if field):
            if separator == "\t" and len(fields) == TEXT_COLUMNS:
                return
            found = f"a table of {len(fields)} columns" + (f" separated by {word}" if word else "")
            raise FormatError(
                path, f"{found} without a header", f"{OURS}: write the names of the columns above", 1
            )
        names = {field.lower().replace(" ", "_") for field in fields}
        kind = next((what for keys, what in KNOWN if keys <= names), "a table of another layout")
        separated = f", separated by {word}" if word else ""
        shown = ", ".join(fields[:8]) + (", ..." if len(fields) > 8 else "")
        raise FormatError(
            path, f"{kind} (columns {shown}{separated})", f"{OURS}: rename or convert its columns", 1
        )


def _is_number(text: str) -> bool:
    try:
        float(text.replace(",", "."))
    except ValueError:
        return False
    return True
