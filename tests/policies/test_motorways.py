"""Recordings of motorways in their publishers' layouts, made here by their published columns."""

from __future__ import annotations

import json

import numpy as np
import polars as pl
import pytest

from policies.data.motorways.road_line import road_line
from policies.data.motorways.tracks import at_ten_hertz
from policies.data.ngsim_import import import_file
from policies.data.ngsim_schema import FLAGS, FormatError
from policies.data.tables import read_tables
from tests.policies.motorway_files import LANE_M, RADIUS_M, dlr_text, drives

FOOT = 0.3048


@pytest.fixture(scope="module")
def a39(tmp_path_factory):
    folder = tmp_path_factory.mktemp("dlr")
    (folder / "trajectories_1.csv").write_text(dlr_text())
    report = import_file(folder / "trajectories_1.csv", folder / "out")
    return folder / "out", pl.read_parquet(folder / "out" / "trajectories_1.parquet"), report


def test_a_motorway_in_the_plane_becomes_one_recording_a_carriageway(a39):
    _, table, report = a39
    found = {r["recording"]: r for r in report["recordings"]}
    assert set(found) == {"a39-E 2024-10-07T06:00:00Z", "a39-W 2024-10-07T06:00:00Z"}
    assert report["source"] == "dlr-highway"
    assert all(r["vehicles"] == 24 and set(r["rows_by_lane"]) == {"1", "2"} for r in found.values())
    assert not table["flags"].is_in([FLAGS["jump"][0], FLAGS["backward_step"][0]]).any()
    assert (table["flags"] & FLAGS["interpolated"][0] > 0).sum() == 2 * 10
    assert (
        dict(table.group_by("vehicle_id").agg(pl.col("vehicle_class").first()).iter_rows())[1728280701706085]
        == "truck"
    )


def test_speeds_lanes_and_gaps_are_those_that_were_driven(a39):
    _, table, _ = a39
    steady = table.filter((pl.col("vehicle_id") % 100 != 87) & (pl.col("lane") == 1)).sort(
        "vehicle_id", "frame"
    )
    step = steady.with_columns(pl.col("x_m").diff().over("recording", "vehicle_id"))["x_m"].drop_nulls()
    assert np.median(np.abs(step - 3.6)) < 0.02  # 36 m/s in the lane; the line lies up to a lane beside it
    known = steady.filter(pl.col("preceding_id").is_not_null() & (pl.col("vehicle_class") == "car"))
    assert np.median(np.abs(known["gap_m"] - (18.0 - 4.5))) < 0.1
    changed = table.filter(pl.col("vehicle_id") == 1728280701706087).sort("frame")["lane"].to_list()
    assert (changed[0], changed[-1]) == (2, 1)


def test_the_road_is_told_from_its_tracks(a39):
    _, _, report = a39
    for road in report["roads"].values():
        first, second = road["lanes_left_m"]
        assert first - second == pytest.approx(LANE_M, abs=0.15)
        radius = np.hypot(np.array(road["x_m"]) - 600_000.0, np.array(road["y_m"]) - 5_790_000.0 - RADIUS_M)
        assert np.ptp(radius[2:-2]) < 0.25


def test_the_line_does_not_follow_a_lane_change_of_the_longest_track():
    rows = []
    for v, t, along, _, left, _ in drives(rate=10.0):
        if v != 3:
            rows.append((v, round(10 * t), along, left))
    for k in range(120):  # the longest track of all, which changes lanes in the middle
        rows.append((99, k, 4.5 * k, LANE_M * (-0.5 + np.clip((k - 40) / 40.0, 0.0, 1.0))))
    table = pl.DataFrame(rows, schema=["vehicle_id", "frame", "x_m", "y_m"], orient="row").sort(
        "vehicle_id", "frame"
    )
    line, _, _ = road_line(table)
    assert np.ptp(line.curve[1][50:400]) < 0.4
    assert line.lane_width_m == pytest.approx(LANE_M, abs=0.2)


def test_scenes_are_read_from_them(a39):
    folder, _, _ = a39
    scenes, passed = read_tables(folder)
    assert passed == []
    assert len(scenes) == 2
    assert all(len(scene.road.lane_left) == 2 for scene in scenes)
    driven = scenes[0].speed[scenes[0].usable]
    assert 29.0 < driven.min() < driven.max() < 37.0


def test_tracks_of_25_hz_are_brought_to_10_hz_and_gaps_stay():
    t = np.r_[np.arange(50) / 25.0, 3.0 + np.arange(25) / 25.0]
    rows = pl.DataFrame({"vehicle_id": np.ones(75, int), "t_s": t, "x_m": 15.0 * t**2})
    found = at_ten_hertz(rows)
    frames = found["frame"].to_list()
    assert frames == [*range(20), *range(30, 40)]
    assert np.abs(found["x_m"] - 15.0 * (found["frame"] * 0.1) ** 2).max() <= 30.0 * 0.04**2 / 8.0 + 1e-9


def highd(folder) -> None:
    rows = ["frame,id,x,y,width,height,xVelocity,yVelocity,xAcceleration,yAcceleration,precedingId,laneId"]
    meta = ["id,width,height,initialFrame,finalFrame,numFrames,class,drivingDirection"]
    for direction, base in ((1, 0), (2, 100)):
        for v in range(6):
            lane = v % 2  # 0: the left one
            kind = "Truck" if lane and v == 1 else "Car"
            length = 12.0 if kind == "Truck" else 4.4
            meta.append(f"{base + v + 1},{length},1.9,1,50,50,{kind},{direction}")
            middle = 8.0 + 8.9 - (3.9 * lane + 1.9) if direction == 1 else 21.0 + 4.0 * lane + 2.0
            for k in range(1, 51):
                driven = 30.0 * v + 32.0 * (k - 1) / 25.0
                x = (400.0 - driven if direction == 1 else driven) - 0.5 * length
                speed = -32.0 if direction == 1 else 32.0
                rows.append(
                    f"{k},{base + v + 1},{x:.3f},{middle - 0.95:.3f},{length},1.9,{speed},0,0,0,0,{2 + lane}"
                )
    (folder / "07_tracks.csv").write_text("\n".join(rows))
    (folder / "07_tracksMeta.csv").write_text("\n".join(meta))
    (folder / "07_recordingMeta.csv").write_text(
        "id,frameRate,locationId,upperLaneMarkings,lowerLaneMarkings\n7,25,2,9.1;13.0;16.9,21.0;25.0;29.0\n"
    )


def test_highd_boxes_are_centred_and_lanes_count_from_the_left_on_both_carriageways(tmp_path):
    highd(tmp_path)
    import_file(tmp_path / "07_tracks.csv", tmp_path / "out")
    table = pl.read_parquet(tmp_path / "out" / "07_tracks.parquet")
    assert sorted(table["recording"].unique()) == ["07-lower 0", "07-upper 0"]
    assert table["flags"].sum() == 0
    for (_, vehicle), track in table.group_by("recording", "vehicle_id"):
        v = (vehicle - 1) % 100
        assert track["lane"].unique().to_list() == [1 + v % 2]
        assert track.sort("frame")["x_m"].diff().drop_nulls().to_list() == pytest.approx(
            [3.2] * (track.height - 1)
        )
        assert track["length_m"][0] == (12.0 if v == 1 else 4.4)
    truck = table.filter(pl.col("vehicle_class") == "truck").sort("recording", "frame")
    assert truck["vehicle_id"].unique().to_list() == [2, 102]
    assert np.allclose(truck["gap_m"], 60.0 - 0.5 * (12.0 + 4.4))


def exid(folder) -> None:
    rows = ["recordingId,trackId,frame,xCenter,yCenter,heading,width,length,xVelocity,yVelocity,laneletId"]
    for v, t, along, _, left, speed in drives(rate=25.0):
        rows.append(f"3,{v},{round(25 * t)},{along:.3f},{left - 900.0:.3f},0,1.9,4.6,{speed},0,12")
    meta = ["recordingId,trackId,initialFrame,finalFrame,numFrames,width,length,class"]
    meta += [
        f"3,{v},0,299,300,1.9,4.6,{'van' if v == 2 else 'truck' if v == 4 else 'car'}" for v in range(24)
    ]
    (folder / "03_tracks.csv").write_text("\n".join(rows))
    (folder / "03_tracksMeta.csv").write_text("\n".join(meta))
    (folder / "03_recordingMeta.csv").write_text("recordingId,frameRate,speedLimit\n3,25,-1\n")


def test_exid_tracks_find_their_lanes(tmp_path):
    exid(tmp_path)
    report = import_file(tmp_path / "03_tracks.csv", tmp_path / "out")
    table = pl.read_parquet(tmp_path / "out" / "03_tracks.parquet")
    assert [r["recording"] for r in report["recordings"]] == ["03-E 0"]
    assert table.filter(pl.col("vehicle_id") == 0)["lane"].unique().to_list() == [1]
    assert table.filter(pl.col("vehicle_id") == 1)["lane"].unique().to_list() == [2]
    assert dict(table.select("vehicle_id", "vehicle_class").unique().iter_rows())[4] == "truck"


def i24(direction: int = 1, **changes) -> list[dict]:
    found = []
    for v in range(4):
        t = 1669118400.0 + np.arange(60) / 25.0
        x = direction * (1000.0 + 150.0 * v + 90.0 * (t - t[0]))
        found.append({
            "_id": {"$oid": f"{v:024d}"}, "timestamp": t.tolist(), "x_position": x.tolist(),
            "y_position": [direction * (6.0 + 12.0 * (v % 2))] * 60, "length": 15.0 if v else [60.0] * 60, "width": 6.0,
            "height": 5.0, "direction": direction, "coarse_vehicle_class": 0 if v else 4,
        } | changes)  # fmt: skip
    return found


def test_i24_documents_of_both_directions(tmp_path):
    documents = i24(1) + i24(-1)
    texts = {"array": json.dumps(documents, indent=1), "lines": "\n".join(map(json.dumps, documents))}
    tables = []
    for name, text in texts.items():
        (tmp_path / f"{name}.json").write_text(text)
        import_file(tmp_path / f"{name}.json", tmp_path / "out")
        tables.append(pl.read_parquet(tmp_path / "out" / f"{name}.parquet"))
    table = tables[0]
    assert table.equals(tables[1])
    assert sorted(table["recording"].unique()) == ["i24-eastbound 1669118400", "i24-westbound 1669118400"]
    truck = table.filter((pl.col("vehicle_class") == "truck") & (pl.col("frame") == 0))
    assert truck["lane"].to_list() == [1, 1]
    assert np.allclose(truck["x_rear_m"] - truck["x_front_m"], -60.0 * FOOT)
    assert np.allclose(truck["gap_m"], (300.0 - 60.0) * FOOT)
    assert np.allclose(table["speed_mps"], 90.0 * FOOT)
    assert table["flags"].sum() == 0


WRONG = {
    "i24 class": (json.dumps(i24(coarse_vehicle_class=9)), "class 9 in document 1, expected one of 0, 1"),
    "i24 lengths": (json.dumps(i24(x_position=[1.0])), "values in document 1 that do not go together"),
    "i24 cut": (json.dumps(i24())[:-900], "JSON that ends or breaks"),
    "i24 fields": (json.dumps([{"x_position": [1], "coarse_vehicle_class": 1}]), "no timestamp in document 1"),
    "DLR time": (dlr_text().replace("2024-10-07 06:00:00.104659", "noon", 1), "'noon.*, expected a time such as"),
    "DLR number": (dlr_text().replace(",36.0,", ",fast,", 1), "line 2, column velocity_magnitude: .*fast"),
    "DLR short": ("\n".join(dlr_text().splitlines()[:6]), "expected tracks along a motorway"),
}  # fmt: skip


@pytest.mark.parametrize("name", WRONG)
def test_faults_are_told_by_file_and_place(tmp_path, name):
    text, message = WRONG[name]
    (tmp_path / "given.csv").write_text(text)
    with pytest.raises(FormatError, match=message) as refused:
        import_file(tmp_path / "given.csv", tmp_path / "out")
    assert "\n" not in str(refused.value)
    assert not list((tmp_path / "out").glob("*.parquet"))


def test_highd_lines_that_are_none_are_told(tmp_path):
    highd(tmp_path)
    (tmp_path / "07_recordingMeta.csv").write_text(
        "id,frameRate,upperLaneMarkings,lowerLaneMarkings\n7,25,9.1,21;25;29\n"
    )
    with pytest.raises(
        FormatError, match=r"07_recordingMeta.csv.*column upperLaneMarkings.*two or more y of lines"
    ):
        import_file(tmp_path / "07_tracks.csv", tmp_path / "out")
