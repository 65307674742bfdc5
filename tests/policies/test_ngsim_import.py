"""Recordings in every layout become one table: values by hand, flags, errors that say where.

Long because every layout brings its own few lines of recordings.
"""

import json

import polars as pl
import pytest
from click.testing import CliRunner
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from policies.data.ngsim_flags import finish
from policies.data.ngsim_import import import_file
from policies.data.ngsim_schema import FLAGS, SCHEMA, FormatError, names_of
from policies.data.ngsim_text import COLUMNS, read_csv, read_text
from service.front.cli.main import main

T0_MS = 1113437564900
HEADER = (
    "Vehicle_ID,Frame_ID,Total_Frames,Global_Time,Local_X,Local_Y,Global_X,Global_Y,v_length,v_Width,v_Class,v_Vel,"
    "v_Acc,Lane_ID,O_Zone,D_Zone,Int_ID,Section_ID,Direction,Movement,Preceding,Following,Space_Headway,Time_Headway,"
    "Location"
)


def line(vehicle=3, frame=613, x=20.0, y=100.0, length=15.0, width=6.0, speed=10.0, accel=0.0, lane=3, ahead=0,
         headway=0.0):  # fmt: skip
    time = T0_MS + 100 * frame
    return (
        f"  {vehicle} {frame} 1153\t{time} {x} {y} 6042851.5 2133134.7 {length} {width} 2 {speed} {accel} {lane} "
        f"{ahead} 0 {headway} 9999.99"
    )


def written(tmp_path, text, name="trajectories-0515-0530.txt"):
    path = tmp_path / name
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path


def imported(tmp_path, text, name="trajectories-0515-0530.txt", **options):
    report = import_file(written(tmp_path, text, name), tmp_path / "out", **options)
    table = pl.read_parquet(tmp_path / "out" / f"{name.rpartition('.')[0]}.parquet")
    assert dict(table.schema) == SCHEMA
    return table, report


def test_a_row_of_the_official_file_in_metres_and_seconds(tmp_path):
    table, report = imported(tmp_path, line(ahead=2, headway=50.0) + "\n")
    row = table.row(0, named=True)
    assert row["recording"] == "trajectories-0515-0530 2005-04-14T00:12:44Z"
    assert row["source"] == "ngsim-text"
    assert (row["vehicle_id"], row["frame"], row["lane"], row["preceding_id"]) == (3, 613, 3, 2)
    assert row["following_id"] is None
    assert row["time_s"] == pytest.approx(61.3)
    assert row["epoch_s"] == pytest.approx(1113437626.2, abs=1e-6)
    assert row["x_front_m"] == pytest.approx(30.48)  # 100 ft
    assert row["x_m"] == pytest.approx(30.48 - 7.5 * 0.3048)
    assert row["x_rear_m"] == pytest.approx(30.48 - 15 * 0.3048)
    assert row["y_m"] == pytest.approx(-6.096)  # to the right of the left edge
    assert row["speed_mps"] == pytest.approx(3.048)
    assert row["length_m"] == pytest.approx(4.572)
    assert row["vehicle_class"] == "car"
    assert row["space_headway_m"] == pytest.approx(15.24)
    assert row["time_headway_s"] == pytest.approx(5.0)  # 9999.99 means none: 15.24 / 3.048
    assert row["gap_m"] is None  # the vehicle ahead is not recorded
    assert row["flags"] == 0
    assert report["units_found"] == "feet"
    assert report == json.loads((tmp_path / "out" / "trajectories-0515-0530.json").read_text())


def test_rows_that_cannot_be_are_flagged_and_stay(tmp_path):
    rows = [
        line(frame=1, y=100.0),
        line(frame=2, y=99.0),
        line(frame=3, y=101.0, accel=11.2),
        line(frame=3, y=101.0, accel=-11.2),
        line(frame=7, y=103.0, speed=200.0),
        line(frame=8, y=203.0, accel=40.0, lane=9, length=0.2),
        line(vehicle=4, frame=8, y=195.0, ahead=3),
        line(vehicle=5, frame=8, y=200.0).replace(str(T0_MS + 800), str(T0_MS + 5800)),
    ]
    table, report = imported(tmp_path, "\n".join(rows))
    assert [names_of(f) for f in table["flags"]] == [
        [],
        ["backward_step"],
        ["duplicate_frame", "accel_clipped"],
        ["duplicate_frame", "accel_clipped"],
        ["frame_gap", "speed_limit"],
        ["jump", "accel_limit", "bad_lane", "bad_size"],
        [],
        ["clock"],
    ]
    assert table.row(6, named=True)["gap_m"] == pytest.approx((203.0 - 0.2 - 195.0) * 0.3048)
    assert report["rows"] == len(rows)
    assert report["rows_without_flag"] == 2
    assert report["flagged_rows"]["duplicate_frame"] == 2
    assert set(report["flagged_rows"]) == set(FLAGS)


def test_a_front_beyond_the_leader_s_rear_is_an_overlap(tmp_path):
    text = "\n".join([line(1, 5, y=100.0, length=15.0), line(2, 5, y=86.0, ahead=1)])
    table, _ = imported(tmp_path, text)
    assert [names_of(f) for f in table["flags"]] == [[], ["overlap"]]
    assert table["gap_m"][1] == pytest.approx(-0.3048)


def csv_row(location="i-80", vehicle="3", time=f"{T0_MS + 61300:,}", y="1,000.5"):
    return f'{vehicle},613,1153,"{time}",20,"{y}","6,042,851.5","2,133,134.7",15,6,2,10,0,3,,,,,,,0,0,0,0,{location}'


def test_the_portal_s_export_with_thousands_separators_and_several_locations(tmp_path):
    later = f"{T0_MS + 61300 + 900_000:,}"
    rows = [HEADER, csv_row(), csv_row("us-101"), csv_row(time=later), csv_row(vehicle='"1,004"')]
    table, report = imported(tmp_path, "\r\n".join(rows) + "\r\n", "export.csv")
    assert report["source"] == "ngsim-csv"
    assert [(r["recording"], r["vehicles"]) for r in report["recordings"]] == [
        ("i-80 2005-04-14T00:12:44Z", 2),
        ("i-80 2005-04-14T00:27:44Z", 1),
        ("us-101 2005-04-14T00:12:44Z", 1),
    ]
    assert set(table["vehicle_id"]) == {3, 1004}
    assert table["x_front_m"].to_list() == [pytest.approx(1000.5 * 0.3048)] * 4
    assert table["flags"].sum() == 0


def test_a_file_without_a_usable_clock_stays_one_recording(tmp_path):
    rows = [line(v).replace(str(T0_MS + 61300), str(T0_MS + 90_000 * v)) for v in range(300)]
    table, report = imported(tmp_path, "\n".join(rows))
    assert len(report["recordings"]) == 1
    assert "clock" in names_of(table["flags"][0])


def test_units_are_told_by_the_cars_lengths_or_by_the_user(tmp_path):
    text = line(length=4.5, width=1.8, y=100.0)
    table, report = imported(tmp_path, text)
    assert (report["units_found"], table["x_front_m"][0]) == ("metres", 100.0)
    table, report = imported(tmp_path, text, units="feet")
    assert (report["units_found"], table["x_front_m"][0]) == ("feet", pytest.approx(30.48))


def test_lane_offsets_are_measured_from_the_lane_s_median(tmp_path):
    rows = [line(v, 1, x=20.0 + (v == 21) * 2.0, y=100.0 + v * 0.01, lane=3) for v in range(1, 22)]
    table, _ = imported(tmp_path, "\n".join([*rows, line(99, 1, x=30.0, lane=4)]))
    assert table["lane_offset_m"][20] == pytest.approx(-0.6096)  # 2 ft to the right
    assert table["lane_offset_m"][0] == pytest.approx(0.0)
    assert table["lane_offset_m"][21] is None  # too few vehicles to know the lane's centre


@pytest.mark.parametrize("size", [200, 1000, 1 << 20])
def test_blocks_of_any_size_give_the_same_rows(tmp_path, size):
    path = written(tmp_path, "\n".join(line(frame=f, y=f) + " " * (f % 3) for f in range(50)) + "\n\n")
    table = pl.concat(read_text(path, size))
    assert table["frame"].to_list() == list(range(50))
    assert table["local_y"].to_list() == list(range(50))


GOOD = [line(frame=f) for f in range(4)]


@pytest.mark.parametrize(
    ("bad", "message"),
    [
        ("1 2 3", r"line 3: found 3 values, expected 18 values"),
        (line().replace("20.0", "x7"), r"line 3, column 5 \(local_x\): found 'x7', expected a number"),
        (line().replace("613", "61.5"), r"line 3, column 2 \(frame\): found '61.5', expected a whole number"),
        (line().replace("20.0", "nan"), r"line 3, column 5 \(local_x\): found 'nan'"),
        (line().replace("20.0", "1e300"), r"line 3, column 5 .*a number of a sensible size"),
        (line() + " 7", r"line 3: found 19 values"),
        ("\x00\x00", r"line 3: found 1 values"),
    ],
)
def test_a_malformed_line_is_named_with_line_and_column(tmp_path, bad, message):
    path = written(tmp_path, "\n".join([*GOOD[:2], bad, *GOOD[2:]]))
    with pytest.raises(FormatError, match=message):
        import_file(path, tmp_path / "out")
    assert list((tmp_path / "out").iterdir()) == []


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (b"", "no rows"),
        (b"\n\n", "no rows"),
        (b"\xff\xfe\x00", "found text in UTF-16, expected text in UTF-8"),
        (b"\xfa\xfe\x00", r"line 1, column byte 1: found byte 0xfa, expected text in UTF-8"),
        (HEADER.encode(), "no rows"),
        (HEADER.replace("v_Vel", "vel").encode() + b"\n", "line 1: .*expected a column named v_vel"),
        (HEADER.replace("v_Width", "v_Vel").encode() + b"\n", "'v_Vel' twice"),
        (
            f"{HEADER}\n{csv_row()}\n{csv_row(y='1,00')}\n".encode(),
            r"line 3, column 6 \(local_y\): found '1,00'",
        ),
        (f"{HEADER}\n{csv_row(y='')}\n".encode(), r"line 2, column 6 \(local_y\): found nothing"),
        (f'{HEADER}\n3,"6\n'.encode(), r"line 2: .*expected a CSV row"),
        (b"PAR1 and no more", "Parquet"),
    ],
)
def test_a_malformed_file_is_refused(tmp_path, text, message):
    with pytest.raises(FormatError, match=message):
        import_file(written(tmp_path, text, "a.csv"), tmp_path / "out")


def test_an_unknown_parquet_file_and_a_broken_value_are_refused(tmp_path):
    pl.DataFrame({"a": [1]}).write_parquet(tmp_path / "a.parquet")
    with pytest.raises(FormatError, match="found columns a, expected the columns of one of coifman"):
        import_file(tmp_path / "a.parquet", tmp_path / "out")
    event = {"event": [1, None], "k": [0, 1], "spacing_m": [3.0, 2.0]}
    speeds = {"foll_v_mps": [1.0, 1.0], "rel_v_mps": [0.0, 0.0], "lead_v_mps": [1.0, 1.0]}
    pl.DataFrame(event | speeds).write_parquet(tmp_path / "b.parquet")
    with pytest.raises(FormatError, match="line 2, column event: found None, expected a whole number"):
        import_file(tmp_path / "b.parquet", tmp_path / "out")


def test_the_rear_bumper_of_coifman_stays_the_rear_bumper(tmp_path):
    rows = {
        "vehicle_id": [1, 2],
        "frame_id": [7, 7],
        "local_y_ft": [1000.0, 1050.0],
        "v_vel_ftps": [30.0, 30.0],
    }
    rest = {"v_acc_ftps2": [0.0, 0.0], "lane_id": [2, 2], "preceding": [2, 0], "following": [0, 1]}
    pl.DataFrame(rows | rest).write_parquet(tmp_path / "c.parquet")
    report = import_file(tmp_path / "c.parquet", tmp_path / "out")
    row = pl.read_parquet(tmp_path / "out" / "c.parquet").row(0, named=True)
    assert report["source"] == "coifman"
    assert row["x_rear_m"] == pytest.approx(304.8)
    assert (row["x_m"], row["x_front_m"], row["gap_m"]) == (None, None, None)
    assert row["space_headway_m"] == pytest.approx(15.24)  # rear to rear
    assert row["preceding_id"] == 2


def test_bumpers_follow_from_the_centre_and_neighbours_from_a_complete_scene():
    table = finish(
        pl.DataFrame(
            {"vehicle_id": [1, 2, 3], "frame": [0, 0, 0], "x_m": [50.0, 30.0, 40.0], "length_m": [4.0, 6.0, 5.0],
             "lane": [1, 1, 2], "speed_mps": [9.0, 10.0, 8.0]}
        ),
        complete=True,
    )  # fmt: skip
    assert table["x_front_m"].to_list() == [52.0, 33.0, 42.5]
    assert table["x_rear_m"].to_list() == [48.0, 27.0, 37.5]
    assert table["preceding_id"].to_list() == [None, 1, None]
    assert table["following_id"].to_list() == [2, None, None]
    assert table["gap_m"].to_list() == [None, 15.0, None]
    assert table["space_headway_m"].to_list() == [None, 19.0, None]
    assert table["time_headway_s"].to_list() == [None, pytest.approx(1.9), None]


def test_the_command_ends_with_2_and_one_sentence_for_a_bad_file(tmp_path):
    path = written(tmp_path, "1 2 3\n")
    result = CliRunner().invoke(main, ["data", "import", str(path), "--out", str(tmp_path / "out")])
    assert result.exit_code == 2
    assert "line 1: found 3 values, expected 18 values" in result.output
    result = CliRunner().invoke(
        main, ["data", "import", str(tmp_path / "no.txt"), "--out", str(tmp_path / "out")]
    )
    assert (result.exit_code, "no such file" in result.output) == (2, True)


def test_the_command_prints_a_report_and_the_schema(tmp_path):
    path = written(tmp_path, "\n".join(GOOD))
    result = CliRunner().invoke(main, ["data", "import", str(path), "--out", str(tmp_path / "out"), "--json"])
    assert result.exit_code == 0
    assert json.loads(result.output)[0]["rows"] == 4
    result = CliRunner().invoke(main, ["data", "schema"])
    assert all(f"{name}" in result.output for name in [*SCHEMA, *FLAGS])
    assert set(json.loads(CliRunner().invoke(main, ["data", "schema", "--json"]).output)["flags"]) == set(
        FLAGS
    )


FUZZ = settings(max_examples=120, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
_TOKEN = st.one_of(
    st.sampled_from(["1", "-3", "2.5", "1e5", ".5", "nan", "inf", "", "1e999", "1,000", "0x1", '"', "é", "\r", "\x0b"]),
    st.text(max_size=4),
)  # fmt: skip


def _mutated(draw, lines: list[str], separator: str) -> bytes:
    rows = [list(row.split(separator)) for row in lines]
    for _ in range(draw(st.integers(0, 3))):
        row = rows[draw(st.integers(0, len(rows) - 1))]
        place = draw(st.integers(0, len(row)))
        if draw(st.booleans()) and place < len(row):
            row[place] = draw(_TOKEN)
        else:
            row.insert(place, draw(_TOKEN))
    text = draw(st.sampled_from(["\n", "\r\n"])).join(separator.join(row) for row in rows)
    return text.encode("utf-8", "surrogatepass") + draw(st.binary(max_size=3))


def _good_or_typed(path, read, size):
    try:
        table = pl.concat(read(path, size))
    except FormatError:
        return
    assert table.height >= 1
    assert table["speed"].is_finite().all()
    assert (table["frame"] % 1 == 0).all()


@FUZZ
@given(data=st.data(), size=st.sampled_from([64, 1 << 20]))
def test_any_text_file_is_read_or_refused(tmp_path, data, size):
    text = _mutated(data.draw, [" ".join(row.split()) for row in GOOD], " ")
    _good_or_typed(written(tmp_path, text), read_text, size)


@FUZZ
@given(data=st.data(), size=st.sampled_from([64, 1 << 20]))
def test_any_csv_file_is_read_or_refused(tmp_path, data, size):
    text = _mutated(data.draw, [HEADER, csv_row(), csv_row("us-101")], ",")
    _good_or_typed(written(tmp_path, text), read_csv, size)


@FUZZ
@given(text=st.binary(max_size=300))
def test_any_bytes_are_imported_or_refused(tmp_path, text):
    try:
        import_file(written(tmp_path, text, "x.txt"), tmp_path / "out")
    except FormatError:
        return
    assert pl.read_parquet(tmp_path / "out" / "x.parquet").height


@FUZZ
@given(values=st.lists(st.floats(-1e15, 1e15), min_size=len(COLUMNS), max_size=len(COLUMNS)))
def test_any_finite_numbers_are_imported_or_refused(tmp_path, values):
    row = " ".join(
        str(int(v)) if i in (0, 1, 2, 3, 10, 13, 14, 15) else repr(v) for i, v in enumerate(values)
    )
    try:
        import_file(written(tmp_path, row, "x.txt"), tmp_path / "out")
    except FormatError as error:
        refused = str(error)
    else:
        return
    assert "sensible size" in refused


# layout -> (a small file, what its first row must become)
PACK = {
    "perl": (
        {"chain": ["a"] * 2, "t_s": [5.0, 5.0], "order": [2, 1], "vehicle_id": [7, -1], "y_m": [20.0, 50.0],
         "v_mps": [8.0, 9.0], "a_mps2": [0.5, 0.0]},
        {"vehicle_id": -1, "frame": 0, "x_front_m": 50.0, "x_m": None, "preceding_id": None, "speed_mps": 9.0},
    ),
    "durraniu": (
        {"vehicle_id": ["47"], "frame_id": [510.0], "local_x": [2.4], "local_y": [22.0], "v_length": [4.0],
         "v_width": [1.8], "v_class": ["2"], "v_vel": [4.0], "v_acc": [1.1], "lane_id": ["1"], "preceding": ["39"],
         "space_headway": [18.0], "time_headway": [2.6], "preceding_local_y": [37.0], "preceding_length": [5.0]},
        {"vehicle_id": 47, "x_front_m": 22.0, "x_m": 20.0, "y_m": -2.4, "lane": 1, "preceding_id": 39, "gap_m": 10.0,
         "space_headway_m": 15.0, "time_headway_s": 3.75, "vehicle_class": "car"},
    ),
    "jiang": (
        {"pair": [1], "k": [0], "lead_pos_ft": [200.0], "lead_v_ftps": [20.0], "lead_a_ftps2": [1.0],
         "foll_pos_ft": [100.0], "foll_v_ftps": [10.0], "foll_a_ftps2": [0.0]},
        {"vehicle_id": 1, "x_front_m": 60.96, "x_m": None, "speed_mps": 6.096, "accel_mps2": 0.3048, "following_id": 2},
    ),
    "zhu": (
        {"event": [3], "k": [4], "spacing_m": [12.0], "foll_v_mps": [8.0], "rel_v_mps": [1.0], "lead_v_mps": [9.0]},
        {"vehicle_id": 1, "frame": 4, "x_front_m": None, "speed_mps": 9.0, "gap_m": None},
    ),
    "smarts": (
        {"vehicle_id": [9], "sim_time": [7.9], "position_x": [10.0], "position_y": [21.0],
         "heading_rad": [1.5 * 3.141592653589793 + 0.1], "speed": [3.0], "lane_id": [2], "type": [3], "length": [8.0],
         "width": [2.0]},
        {"frame": 79, "x_m": 10.0, "x_front_m": 14.0, "x_rear_m": 6.0, "heading_rad": 0.1, "vehicle_class": "truck"},
    ),
    "vineet": (
        {"Vehicle_ID": [5], "Frame_ID": [10], "Global_Time": [1_000_000], "Local_X": [8.0], "Local_Y": [75.0],
         "v_length": [4.0], "v_Class": [2], "v_Vel": [10.0], "v_Acc": [3.41376], "Lane_ID": [3], "Preceding": [4],
         "Following": [0], "Space_Headway": [17.0], "Time_Headway": [1.7], "L-F_Pair": ["4-5"],
         "preceding_vehicle_length": [4.5]},
        {"recording": "i80-pair-4-5", "epoch_s": 1000.0, "x_m": 73.0, "gap_m": 12.5, "following_id": None, "flags": 64},
    ),
    "i80-scene": (
        {"scene_id": ["s"], "vehicle_id": [1], "frame": [3], "x_m": [20.0], "y_m": [-4.0], "lane": [2],
         "lane_offset_m": [None], "heading_est_rad": [0.01], "speed_est_mps": [6.0], "length_est_m": [6.1]},
        {"x_front_m": 20.0, "length_m": 5.0, "x_m": 17.5, "lane_offset_m": None, "width_m": None},
    ),
    "us101-scene": (
        {"scene_id": ["s"], "vehicle_id": [1], "frame": [3], "s_m": [20.0], "d_m": [4.0], "lane": [2],
         "lane_offset_m": [0.2], "heading_rad": [-3.1], "lane_heading_rad": [3.1], "speed_mps": [6.0],
         "accel_mps2": [0.0], "length_m": [4.0], "width_m": [1.8], "type": ["car"]},
        {"x_m": 20.0, "x_front_m": 22.0, "y_m": 4.0, "heading_rad": 2 * 3.141592653589793 - 6.2, "lane_offset_m": 0.2},
    ),
}  # fmt: skip


@pytest.mark.parametrize("layout", PACK)
def test_each_derived_file_is_known_by_its_columns_and_converted(tmp_path, layout):
    given_columns, expected = PACK[layout]
    table = pl.DataFrame(given_columns)
    table.with_columns(pl.col(pl.Null).cast(pl.Float64)).write_parquet(tmp_path / "t.parquet")
    report = import_file(tmp_path / "t.parquet", tmp_path / "out")
    row = pl.read_parquet(tmp_path / "out" / "t.parquet").row(0, named=True)
    assert report["source"] == row["source"] == layout
    for name, value in expected.items():
        assert row[name] == (pytest.approx(value) if isinstance(value, float) else value), name


@FUZZ
@given(data=st.data(), layout=st.sampled_from(sorted(PACK)))
def test_any_values_in_a_derived_file_are_imported_or_refused(tmp_path, data, layout):
    columns = dict(PACK[layout][0])
    name = data.draw(st.sampled_from(sorted(columns)))
    wrong = st.sampled_from(
        [None, float("nan"), float("inf"), -1e300, 2.5, 2**62, "x", "", True, b"x", [1.0], -1]
    )
    columns[name] = [data.draw(wrong), *columns[name][1:]]
    try:
        table = pl.DataFrame(columns, strict=False)
        table.write_parquet(tmp_path / "t.parquet")
    except (pl.exceptions.PolarsError, TypeError, OverflowError):
        return  # no such table
    try:
        import_file(tmp_path / "t.parquet", tmp_path / "out")
    except FormatError:
        return
    assert pl.read_parquet(tmp_path / "out" / "t.parquet").height >= table.height
