"""Scenes from imported tables: the same motion as from the data pack's own reader, and refusals that say why."""

from pathlib import Path

import numpy as np
import polars as pl
import pytest

from policies.data import recordings as R
from policies.data import scenes as S
from policies.data.neighbours import bumper_gaps, leaders
from policies.data.ngsim_import import import_file
from policies.data.tables import lane_centres, read_tables

SAMPLE = Path(S.__file__).parent / "sample"
T0_MS = 1113437564900
FOOT = 0.3048


@pytest.fixture(scope="module")
def sample_tables(tmp_path_factory):
    """The shipped I-80 sample as the import writes it."""
    folder = tmp_path_factory.mktemp("tables")
    table = pl.read_parquet(SAMPLE / "i80_6s.parquet")
    table = table.with_columns(
        *(
            pl.lit(value).alias(name)
            for name, value in {
                "scene_id": "i80",
                "lane_offset_m": 0.0,
                "heading_est_rad": 0.0,
                "speed_est_mps": 0.0,
            }.items()
            if name not in table.columns
        )
    )
    table.write_parquet(folder / "i80.parquet")
    import_file(folder / "i80.parquet", folder / "out")
    return folder / "out"


def official_text(seconds=40.0, vehicles=16, lanes=3):
    """An official 18-column file: cars at constant speed 18 m apart in each lane; number 5 moves one lane over."""
    rows = []
    for k in range(round(seconds * 10)):
        for v in range(vehicles):
            lane = 1 + v % lanes
            y = 10.0 + 8.0 * k * 0.1 + 18.0 * (vehicles - v) / lanes
            share = min(max((k * 0.1 - 15.0) / 5.0, 0.0), 1.0) if v == 5 else 0.0
            x = 3.7 * (lane - 0.5) - 3.7 * share
            rows.append(
                f"{v + 1} {k} 400 {T0_MS + 100 * k} {x / FOOT:.4f} {y / FOOT:.4f} 6042851.5 2133134.7 15.0 6.0 2 "
                f"{8.0 / FOOT:.4f} 0 {lane - (share > 0.5)} 0 0 0 9999.99"
            )
    return "\n".join(rows) + "\n"


@pytest.fixture(scope="module")
def official(tmp_path_factory):
    folder = tmp_path_factory.mktemp("official")
    (folder / "trajectories-0400.txt").write_text(official_text(), encoding="utf-8")
    import_file(folder / "trajectories-0400.txt", folder / "out")
    return folder / "out"


def test_an_imported_scene_is_the_scene(sample_tables):
    given = S.read_i80(SAMPLE / "i80_6s.parquet", SAMPLE / "i80_lanes.json")
    (scene,), passed = read_tables(sample_tables)
    assert passed == []
    assert np.array_equal(scene.vehicle_id, given.vehicle_id)
    both = scene.usable & given.usable
    assert both.sum() > 0.9 * given.usable.sum()
    assert np.abs(scene.speed - given.speed)[both].max() < 0.3
    assert (scene.lane == given.lane)[both].mean() > 0.98
    assert scene.road.lane_width_m == pytest.approx(given.road.lane_width_m, abs=0.15)


def test_the_official_text_gives_lanes_speeds_and_a_lane_change(official):
    (scene,), _ = read_tables(official)
    assert len(scene.road.lane_left) == 3
    assert scene.road.lane_width_m == pytest.approx(3.7, abs=0.1)
    assert np.abs(scene.speed[scene.usable] - 8.0).max() < 0.5
    assert scene.length_m == pytest.approx(15.0 * FOOT)
    mover = list(scene.vehicle_id).index(6)
    lane = scene.lane[:, mover]
    assert (lane[100], lane[300]) == (2, 1)
    # the last vehicles are held out, and the first one has no leader: it teaches nothing
    assert set(scene.vehicle_id[scene.vehicle_id >= scene.held_out_from]) == {14, 15, 16}
    assert not scene.usable[:, list(scene.vehicle_id).index(1)].any()


def test_leaders_and_gaps_are_those_of_the_lane(official):
    (scene,), _ = read_tables(official)
    ahead = leaders(scene)
    column = list(scene.vehicle_id).index
    assert ahead[50, column(5)] == column(2)
    assert ahead[50, column(2)] == -1
    gap = bumper_gaps(scene, ahead)
    assert gap[50, column(5)] == pytest.approx(18.0 - 15.0 * FOOT, abs=0.05)
    assert np.isnan(gap[50, column(2)])


def test_car_following_events_come_from_the_scenes(official):
    found = R.load_recordings(official)
    assert [len(scenes) for scenes in found.sites.values()] == [1]
    assert list(found.files) == ["trajectories-0400.parquet"]
    assert found.following.shape[2] == 3
    assert np.nanmedian(found.following[:, :, 0]) == pytest.approx(18.0 - 15.0 * FOOT, abs=0.1)
    assert np.nanmedian(found.following[:, :, 1:]) == pytest.approx(8.0, abs=0.05)


def test_recordings_that_are_no_scenes_are_passed_over_with_the_reason(tmp_path, official):
    rows = [{"event": 1, "k": k, "spacing_m": 10.0, "foll_v_mps": 8.0, "lead_v_mps": 8.0} for k in range(200)]
    pl.DataFrame(rows).write_parquet(tmp_path / "zhu.parquet")
    import_file(tmp_path / "zhu.parquet", tmp_path / "out")
    with pytest.raises(S.DataError, match=r"layout zhu .*does not hold every vehicle"):
        read_tables(tmp_path / "out")
    for file in official.glob("*.parquet"):
        (tmp_path / "out" / file.name).write_bytes(file.read_bytes())
    scenes, passed = read_tables(tmp_path / "out")
    assert len(scenes) == 1
    assert len(passed) == 1
    assert "zhu.parquet" in passed[0]


def test_a_folder_without_recordings_is_refused(tmp_path):
    with pytest.raises(S.DataError, match=r"neither the data pack .* nor imported tables"):
        R.load_recordings(tmp_path)
    with pytest.raises(S.DataError, match="no imported table found"):
        read_tables(tmp_path / "nothing")


def test_lane_centres_follow_the_vehicles_and_end_where_lanes_do():
    rng = np.random.default_rng(1)
    n = 6000
    s, lane, vehicle = rng.uniform(0.0, 400.0, n), rng.integers(1, 4, n), rng.integers(0, 60, n)
    right = 3.7 * lane + 0.4 * np.sin(s / 60.0) + rng.normal(0.0, 0.1, n)
    lane[(lane == 3) & (s > 90.0)] = 2  # lane 3 is a short ramp; its rows further on are mistakes
    right[lane == 2] = (7.4 + 0.4 * np.sin(s / 60.0))[lane == 2]
    grid, centres = lane_centres("made", s, right, lane, vehicle)
    assert centres.shape == (2, len(grid))
    assert np.abs(centres[0] - 3.7 - 0.4 * np.sin(grid / 60.0)).max() < 0.15
    with pytest.raises(S.DataError, match="no lane 1"):
        lane_centres("made", s, right, lane + 3, vehicle)
