"""Recorded traffic: smoothing, flags, rectified lanes and the shipped sample."""

import json
from pathlib import Path

import numpy as np
import polars as pl
import pytest

from policies.data import scenes as S
from policies.data.smoothing import derivative, penalty_for_cutoff, smooth, split_at_gaps

SAMPLE = Path(S.__file__).parent / "sample"


@pytest.fixture(scope="module")
def sample():
    return S.read_i80(SAMPLE / "i80_6s.parquet", SAMPLE / "i80_lanes.json")


def test_smoothing_reproduces_constant_acceleration_exactly():
    t = np.arange(80) * 0.1
    x = 5.0 + 12.0 * t - 0.5 * 1.7 * t**2
    z = smooth(x, 0.3)
    assert np.allclose(z, x, atol=1e-7)
    assert np.allclose(derivative(derivative(z))[3:-3], -1.7, atol=1e-4)


def test_smoothing_recovers_the_acceleration_of_a_noisy_braking_manoeuvre():
    rng = np.random.default_rng(3)
    t = np.arange(200) * 0.1
    accel = -2.0 * np.exp(-0.5 * ((t - 10.0) / 1.5) ** 2)
    speed = 20.0 + np.concatenate([[0.0], np.cumsum(0.5 * (accel[1:] + accel[:-1]) * 0.1)])
    x = np.concatenate([[0.0], np.cumsum(0.5 * (speed[1:] + speed[:-1]) * 0.1)])
    noisy = x + rng.normal(0.0, 0.05, len(x))
    raw = np.diff(noisy, 2) / 0.01
    smoothed = derivative(derivative(smooth(noisy, 0.3)))
    inner = slice(10, -10)
    assert raw.std() > 5.0
    assert np.sqrt(np.mean((smoothed - accel)[inner] ** 2)) < 0.25


def test_smoothing_halves_the_cutoff_frequency():
    t = np.arange(2000) * 0.1
    wave = np.sin(2.0 * np.pi * 0.3 * t)
    assert np.ptp(smooth(wave, 0.3)[500:-500]) == pytest.approx(1.0, abs=0.02)
    assert penalty_for_cutoff(0.2) > penalty_for_cutoff(0.3)


@pytest.mark.parametrize("bad", [np.arange(4.0), np.append(np.arange(20.0), np.nan), np.zeros((10, 2))])
def test_smoothing_refuses_what_it_cannot_smooth(bad):
    with pytest.raises(ValueError, match="smooth needs"):
        smooth(bad, 0.3)


def test_tracks_are_split_at_missing_frames():
    assert split_at_gaps(np.array([3, 4, 5, 9, 10])) == [slice(0, 3), slice(3, 5)]


def test_motion_of_a_known_track_on_a_curve():
    """A vehicle that keeps 2 m left of a curve of radius 500 m: its speed is 2/500 lower than the reference's."""
    station = np.arange(400.0)
    curvature = np.full(400, 1.0 / 500.0)
    heading = station / 500.0
    road = S.straight_lanes(
        "curve", 399.0, 3, 3.5, (500.0 * np.sin(heading), 500.0 * (1 - np.cos(heading)), heading, curvature)
    )
    t = np.arange(120) * 0.1
    motion = S.smoothed_motion(10.0 + 20.0 * t, np.full(120, 2.0), road)
    assert np.allclose(motion["speed"], 20.0 * (1.0 - 2.0 / 500.0), atol=1e-6)
    assert np.allclose(motion["turn_rate"][:-1], 20.0 / 500.0, atol=1e-6)
    assert np.allclose(motion["accel"][:-1], 0.0, atol=1e-5)
    assert not motion["flags"].any()
    radius = np.hypot(motion["x"], motion["y"] - 500.0)
    assert np.allclose(radius, 498.0, atol=1e-3)


def test_a_standing_vehicle_points_along_its_lane():
    road = S.straight_lanes("road", 100.0, 2, 3.5)
    rng = np.random.default_rng(1)
    motion = S.smoothed_motion(50.0 + rng.normal(0, 0.03, 100), rng.normal(0, 0.03, 100), road)
    assert np.abs(motion["heading"][8:-8]).max() < 0.02


def test_unphysical_rows_are_flagged_and_not_used():
    road = S.straight_lanes("road", 2000.0, 2, 3.5)
    t = np.arange(150) * 0.1
    backward = S.smoothed_motion(500.0 - 2.0 * t, np.zeros(150), road)
    assert (backward["flags"] & S.BACKWARD).all()
    hard = S.smoothed_motion(30.0 * t - np.where(t > 7.0, 8.0 * (t - 7.0) ** 2, 0.0), np.zeros(150), road)
    assert (hard["flags"] & S.HARD).any()
    sideways = S.smoothed_motion(5.0 * t, 3.0 * np.sin(1.2 * t), road)
    assert (sideways["flags"] & S.SIDEWAYS).any()


def test_the_sample_loads_as_a_scene(sample):
    assert sample.present.sum() > 3000
    assert sample.usable.sum() > 1500
    assert not (sample.usable & (sample.flags > 0)).any()
    assert 3.6 < sample.road.lane_width_m < 3.9
    use = sample.usable
    assert 2.0 < sample.speed[use].mean() < 12.0
    assert 0.3 < sample.accel[use].std() < 1.2
    assert sample.turn_rate[use].std() < 0.05
    centre = (len(sample.road.lane_left) - 1) / 2.0 - sample.lane
    offset = (sample.lateral - centre * sample.road.lane_width_m)[use]
    assert abs(np.median(offset)) < 0.15
    assert np.abs(offset).max() <= 0.5 * sample.road.lane_width_m + 1e-9


def test_actions_integrate_to_the_next_state(sample):
    f, v = np.nonzero(sample.usable)
    speed = sample.speed[f, v] + 0.1 * sample.accel[f, v]
    heading = sample.heading[f, v] + 0.1 * sample.turn_rate[f, v]
    assert np.allclose(speed, sample.speed[f + 1, v], atol=1e-9)
    assert np.allclose(heading, sample.heading[f + 1, v], atol=1e-9)
    moving = sample.speed[f, v] > S.SLOW_MPS
    mean_speed, mean_heading = 0.5 * (sample.speed[f, v] + speed), 0.5 * (sample.heading[f, v] + heading)
    x = sample.x[f, v] + 0.1 * mean_speed * np.cos(mean_heading)
    assert np.abs(x - sample.x[f + 1, v])[moving].max() < 0.01


def test_the_sample_is_small():
    assert sum(path.stat().st_size for path in SAMPLE.iterdir()) < 200_000


def test_a_summary_counts_flags(sample):
    found = S.summary(sample)
    assert found["rows"] == sample.present.sum()
    assert set(found["flagged"]) <= set(S.FLAG_NAMES.values())
    json.dumps(found)


def test_missing_files_and_columns_are_named(tmp_path):
    with pytest.raises(S.DataError, match="no such file"):
        S.read_i80(tmp_path)
    with pytest.raises(S.DataError, match="no such file"):
        S.read_us101(tmp_path)
    path = tmp_path / "bad.parquet"
    path.write_bytes(b"not parquet")
    with pytest.raises(S.DataError, match=r"bad\.parquet: not a readable"):
        S.read_i80(path, SAMPLE / "i80_lanes.json")
    pl.DataFrame({"vehicle_id": [1]}).write_parquet(path)
    with pytest.raises(S.DataError, match=r"columns .*'frame'.* are missing"):
        S.read_i80(path, SAMPLE / "i80_lanes.json")


def test_two_rows_of_a_vehicle_in_one_frame_are_refused(tmp_path):
    table = pl.read_parquet(SAMPLE / "i80_6s.parquet")
    path = tmp_path / "twice.parquet"
    pl.concat([table, table.head(1)]).write_parquet(path)
    with pytest.raises(S.DataError, match="two rows with the same frame"):
        S.read_i80(path, SAMPLE / "i80_lanes.json")
