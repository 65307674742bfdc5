"""Recordings as users have them: through spreadsheets, packed, and in layouts that are not ours."""

from __future__ import annotations

import gzip
import io
import zipfile

import polars as pl
import pytest

from policies.data.ngsim_import import import_file
from policies.data.ngsim_schema import FormatError

HEADER = "Vehicle_ID,Frame_ID,Global_Time,Local_X,Local_Y,v_length,v_Width,v_Class,v_Vel,v_Acc,Lane_ID"


def rows(by: str = "vehicle", time: str = "1.11E+12", periods: int = 3) -> list[str]:
    """Three vehicles over 30 frames in each period, whose numbers and frames all begin anew."""
    keys = [(v, k) for v in range(1, 4) for k in range(10, 40)]
    if by == "frame":
        keys.sort(key=lambda key: key[1])
    found = [
        f"{v},{k},{time},{10 + 12 * v},{100 * v + k + 500 * p},15,6,2,10,0,{v}"
        for p in range(periods)
        for v, k in keys
    ]
    if by == "nothing":
        found = [found[(7 * i + i // 45) % len(found)] for i in range(len(found))]
    return found


def imported(tmp_path, data: str | bytes, name: str = "export.csv") -> tuple[pl.DataFrame, dict]:
    path = tmp_path / name
    path.write_bytes(data.encode() if isinstance(data, str) else data)
    report = import_file(path, tmp_path / "out")
    return pl.read_parquet(tmp_path / "out" / "export.parquet"), report


@pytest.mark.parametrize("by", ["vehicle", "frame"])
def test_periods_behind_a_rounded_clock_are_told_apart_by_the_order_of_rows(tmp_path, by):
    table, report = imported(tmp_path, "\n".join([HEADER, *rows(by)]))
    assert [(r["recording"], r["vehicles"], r["rows"]) for r in report["recordings"]] == [
        (f"export period {n}", 3, 90) for n in (1, 2, 3)
    ]
    assert report["vehicles"] == 9
    assert table["flags"].sum() == 0
    assert table["epoch_s"].null_count() == table.height
    (note,) = report["notes"]
    assert note.startswith("export: Global_Time has 1 different value, as a spreadsheet rounds it")
    for _, track in table.group_by("recording", "vehicle_id"):
        assert track.sort("frame")["x_front_m"].diff().drop_nulls().to_list() == pytest.approx([0.3048] * 29)


def test_periods_that_nothing_tells_apart_are_refused(tmp_path):
    mixed = [row for k in range(90) for row in rows()[k::90]]
    with pytest.raises(FormatError, match="a Global_Time that was rounded, in export, and rows in no order"):
        imported(tmp_path, "\n".join([HEADER, *mixed]))
    assert not list((tmp_path / "out").glob("*.parquet"))


def test_a_clock_in_full_is_taken_as_it_is(tmp_path):
    full = [
        row.replace("1.11E+12", str(1113433136100 + 100 * int(row.split(",")[1]))) for row in rows(periods=1)
    ]
    table, report = imported(tmp_path, "\n".join([HEADER, *full]))
    assert report["notes"] == []
    assert table["epoch_s"].null_count() == 0


def test_packed_tables_are_unpacked(tmp_path):
    text = "\n".join([HEADER, *rows(periods=1)])
    plain, _ = imported(tmp_path, text)
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("folder/export.csv", text)
        archive.writestr("folder/read me.md", "no table")
    for data, name in ((gzip.compress(text.encode()), "export.csv.gz"), (packed.getvalue(), "export.zip")):
        again, _ = imported(tmp_path, data, name)
        assert again.equals(plain)


def test_names_of_columns_may_have_blanks(tmp_path):
    table, _ = imported(tmp_path, "\n".join([HEADER.replace("_", " "), *rows(periods=1)]))
    assert table["vehicle_id"].n_unique() == 3


def two_tables() -> bytes:
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w") as archive:
        archive.writestr("a.csv", HEADER)
        archive.writestr("b.csv", HEADER)
    return packed.getvalue()


FOREIGN = {
    "TGSIM": (
        "id,time,xloc-kf,yloc-kf,lane-kf,speed-kf\n1,0.1,2,3,1,20\n",
        "found a TGSIM table .columns id, time",
    ),
    "SUMO": (
        "timestep_time;vehicle_CO2;vehicle_id;vehicle_x\n0;1;a;2\n",
        "SUMO's output as a table .*semicolons",
    ),
    "SUMO's XML": ("<emission-export>\n</emission-export>", "found XML .'<emission-export>'.*convert it"),
    "highD": (
        "frame,id,x,y,width,height,xVelocity,yVelocity,precedingId\n1,1,2,3,4,2,30,0,0\n",
        "no NAME_tracksMeta.csv beside it, expected the publisher's files NAME_tracks.csv",
    ),
    "semicolons": (HEADER.replace(",", ";") + "\n1;2;3\n", "separated by semicolons"),
    "no header": ("1,10,1.1,22,3,15,6,2,10,0,3\n", "a table of 11 columns without a header"),
    "no names": ("a,b,c\n1,2,3\n", "a table of another layout .columns a, b, c"),
    "UTF-16": ((HEADER + "\n").encode("utf-16"), "text in UTF-16, expected text in UTF-8: save it"),
    "JSON": ('{"type": "FeatureCollection"}', "found JSON"),
    "two tables": (two_tables(), r"2 tables \(a.csv, b.csv\), expected a zip file of one table"),
    "cut": (gzip.compress(b"x" * 90_000)[:-20], "a packed file that cannot be unpacked"),
}


@pytest.mark.parametrize("name", FOREIGN)
def test_tables_of_others_are_named_with_the_columns_needed_and_the_remedy(tmp_path, name):
    data, message = FOREIGN[name]
    with pytest.raises(FormatError, match=message) as refused:
        imported(tmp_path, data)
    assert str(refused.value).startswith(f"{tmp_path / 'export.csv'}")
    assert "\n" not in str(refused.value)
