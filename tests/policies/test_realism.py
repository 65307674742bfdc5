"""What the realism card measures: lane changes, contacts, errors and distances, on motion that is known."""

from dataclasses import replace

import numpy as np
import pytest

from policies.columns import Values
from policies.data.scenes import Scene, straight_lanes
from policies.realism.driven import driven_scene, window_of
from policies.realism.lane_changes import crossings, gap, lane_changes
from policies.realism.measures import QUANTITIES, counts, errors, quantities, resmoothed, touching
from policies.realism.recorded import lane_change_facts
from policies.realism.statistics import bins, distances, histogram, rate, root_mean_square, vehicle_bootstrap
from policies.realism.tails import SHARES, gaps, tail_facts, tails

WIDTH_M = 3.7
LANES = 4  # three main lanes and a ramp


def scene(stations, laterals, speeds) -> Scene:
    """Vehicles with given motion, arrays (F, N), on a straight road of four lanes."""
    road = straight_lanes("made", 2000.0, LANES, WIDTH_M)
    station, lateral, speed = (np.asarray(a, dtype=float) for a in (stations, laterals, speeds))
    shape = station.shape
    lane = np.clip(np.floor(LANES / 2.0 - lateral / WIDTH_M), 0, LANES - 1).astype(np.int64)
    sizes = np.full(shape[1], 4.5), np.full(shape[1], 1.8)
    nothing, whole = np.zeros(shape), np.ones(shape, dtype=bool)
    return Scene(
        "made", 0.1, road, np.arange(shape[0]), np.arange(1, shape[1] + 1), *sizes, station, lateral, nothing, speed,
        np.diff(speed, axis=0, append=speed[-1:]) / 0.1, nothing, station, lateral, lane, np.zeros(shape, np.uint8),
        whole, 99,
    )  # fmt: skip


def centre(lane: int) -> float:
    return (0.5 * (LANES - 1) - lane) * WIDTH_M


def a_lane_change(t, start_s=5.0, takes_s=5.0):
    """Lateral position of a smooth change from lane 2 to lane 1 (1 to 0)."""
    share = np.clip((t - start_s) / takes_s, 0.0, 1.0)
    return centre(1) + WIDTH_M * (share - np.sin(2.0 * np.pi * share) / (2.0 * np.pi))


@pytest.fixture(scope="module")
def cut_in():
    """Vehicle 1 changes to lane 1 between 2 (ahead, 12 m/s) and 3 (behind, 14 m/s); itself 12 m/s."""
    t = np.arange(200) * 0.1
    stations = np.column_stack([100.0 + 12.0 * t, 120.0 + 12.0 * t, 70.0 + 14.0 * t])
    laterals = np.column_stack([a_lane_change(t), np.full(200, centre(0)), np.full(200, centre(0))])
    return scene(stations, laterals, np.broadcast_to([12.0, 12.0, 14.0], (200, 3)))


def test_a_lane_change_is_found_with_its_gaps(cut_in):
    found = lane_changes([cut_in])
    assert len(found) == 1
    assert (found.lane_from[0], found.lane_to[0], found.vehicle[0]) == (1, 0, 0)
    assert found.frame[0] == pytest.approx(75, abs=1)  # half-way, at 7.5 s
    assert found.lateral_speed_mps[0] == pytest.approx(2.0 * WIDTH_M / 5.0, rel=0.02)
    assert 3.5 < found.duration_s[0] < 5.0  # the first and last moments are slower than 0.1 m/s
    assert found.lead_gap_m[0] == pytest.approx(20.0 - 4.5)
    assert np.isinf(found.lead_ttc_s[0])
    lag_gap = 30.0 - 2.0 * 0.1 * found.frame[0] - 4.5
    assert found.lag_gap_m[0] == pytest.approx(lag_gap)
    assert found.lag_ttc_s[0] == pytest.approx(lag_gap / 2.0)
    assert found.lag_min_ttc_s[0] == pytest.approx((lag_gap - 2.0 * 5.0) / 2.0, abs=0.01)


def test_a_short_visit_to_another_lane_is_no_lane_change():
    lane = np.array([2] * 30 + [1] * 5 + [2] * 30)
    assert crossings(lane) == []
    assert crossings(np.array([2] * 30 + [1] * 30)) == [30]
    assert crossings(np.array([2] * 30 + [1] * 3 + [2] * 3 + [1] * 30)) == [36]
    assert crossings(np.array([2] * 30 + [-1] * 5 + [1] * 30)) == []


def test_rates_count_main_lanes_only(cut_in):
    facts = lane_change_facts([cut_in], lane_changes([cut_in]))
    assert facts["lane_changes_main_lanes"] == 1
    km = (12.0 + 12.0 + 14.0) * 20.0 / 1000.0
    assert facts["vehicle_km_main_lanes"] == pytest.approx(km, abs=0.05)
    assert facts["per_vehicle_km"] == pytest.approx(1.0 / km, rel=0.02)
    assert (facts["to_the_left"], facts["to_the_right"]) == (1, 0)
    onto_ramp = replace(cut_in, lateral=cut_in.lateral - 2 * WIDTH_M, lane=cut_in.lane + 2)
    facts = lane_change_facts([onto_ramp], lane_changes([onto_ramp]))
    assert (facts["lane_changes_main_lanes"], facts["from_or_to_the_ramp"]) == (0, 1)


def test_boxes_touch_when_they_overlap():
    still = scene([[100.0, 104.4, 104.6, 104.4]], [[0.0, 0.0, 0.0, 1.9]], [[0.0] * 4])
    assert touching(still, np.arange(4)).tolist() == [[True, True, True, False]]
    assert touching(still, np.array([0])).tolist() == [[True]]
    apart = scene([[100.0, 104.6]], [[0.0, 0.0]], [[0.0] * 2])
    assert not touching(apart, np.arange(2)).any()


def test_gaps_are_between_bumpers():
    row = scene([[100.0, 120.0]], [[0.0, 0.0]], [[10.0, 8.0]])
    metres, closing, headway, ttc = gap(row, 0, 0, 1)
    assert (metres, closing, headway, ttc) == pytest.approx((15.5, 2.0, 1.55, 7.75))


def test_tails_are_shares_of_the_time_inside_the_edges():
    t = np.arange(117) * 0.1  # the inner hundred moments are seen: 0.8 to 10.7 s
    stations = np.column_stack([100.0 + 12.0 * t, 130.0 + 9.0 * t, 100.0 + 12.0 * t])
    laterals = np.column_stack(
        [np.full(117, centre(1)), np.full(117, centre(1)), np.full(117, centre(1) + 2.2)]
    )
    made = scene(stations, laterals, np.broadcast_to([12.0, 9.0, 12.0], (117, 3)))
    every = list(SHARES)

    def of(who: int, name: str, driven=(0, 1, 2)) -> float:
        return tails(made, np.array([who]), np.array(driven, dtype=int))[0, 1 + every.index(name)]

    assert tails(made, np.array([0]), np.arange(3))[0, 0] == 100
    ahead = (stations[:, 1] - stations[:, 0])[8:108]
    left = ahead - 4.5  # bumper to bumper
    assert of(0, "headway_below_0.5_s") == ((left / 12.0 < 0.5) & (ahead > 0.0)).sum()
    for limit in (1.0, 2.0, 3.0):
        assert of(0, f"ttc_below_{limit:g}_s") == ((left > 0.0) & (left / 3.0 < limit)).sum()
    assert of(0, "side_below_0.5_m") == 100  # 2.2 m between centres, 1.8 m wide
    assert of(1, "side_below_0.5_m") == (np.abs(ahead) < 4.5).sum()
    overlapping = (np.abs(ahead) < 4.5).sum()
    assert of(0, "in_other_contact") == of(1, "in_other_contact") == overlapping > 0
    assert of(1, "driven_into_from_behind") == 0
    past = (np.abs(ahead) < 4.5) & (ahead > 0.0)  # until it is past
    assert of(1, "driven_into_from_behind", driven=(1, 2)) == past.sum() > 0
    braking = replace(made, accel=np.where(t[:, None] < 3.8, -2.5, 0.0) * np.ones((1, 3)))
    counts_of = tails(braking, np.array([0]), np.arange(3))[0, 1:]
    assert counts_of[every.index("braking_beyond_2_mps2")] == 30
    assert counts_of[every.index("braking_beyond_3_mps2")] == 0


def test_gaps_accepted_are_told_with_how_many(cut_in):
    found = gaps(cut_in, np.array([0]))
    assert len(found) == 1
    (vehicle, lead, lag) = found[0]
    assert vehicle == cut_in.vehicle_id[0]
    assert lead == pytest.approx(15.5)
    assert lag == pytest.approx(30.0 - 4.5 - 2.0 * 7.5, abs=0.3)
    frames = tails(cut_in, np.array([0]), np.arange(3))
    told = tail_facts(frames, np.array([1]), found, np.random.default_rng(1))
    assert told["gaps"]["lead_gap_m"]["n"] == 1
    assert told["gaps"]["lead_gap_m"]["median"] == told["gaps"]["lead_gap_m"]["smallest"] == 15.5
    assert set(told["shares"]) == set(SHARES)
    nobody = tail_facts(frames, np.array([1]), [], np.random.default_rng(1))
    assert nobody["gaps"]["lag_gap_m"] == {
        "n": 0,
        "median": None,
        "median_interval_95": None,
        "smallest": None,
    }


def test_errors_counts_and_motion_of_a_driven_vehicle():
    t = np.arange(150) * 0.1
    both = np.column_stack([100.0 + 10.0 * t, 160.0 + 10.0 * t])
    recorded = scene(both, np.full((150, 2), centre(1)), np.full((150, 2), 10.0))
    rows = 101
    since = np.arange(rows) * 0.1
    s = both[20, 0] + 10.0 * since + 0.5 * since**2  # 1 m/s^2 for 10 s
    v = 10.0 + np.arange(rows) * 0.1
    d = np.full(rows, centre(1) + 0.3)
    accel = np.where(np.arange(rows) < 7, -3.5, 1.0)
    driven = driven_scene(
        recorded, 20, np.array([0]), s[:, None], d[:, None], v[:, None], accel[:, None], np.zeros((rows, 1))
    )
    error = errors(driven, [10, 100])
    assert error[0, 0] == pytest.approx([np.hypot(0.5, 0.3), 1.0, 0.3])
    assert error[0, 1] == pytest.approx([np.hypot(50.0, 0.3), 10.0, 0.3])
    (row,) = counts(driven.scene, driven.who, driven.accel)
    assert (row.frames, row.hard_brakes, row.off_road, row.lane_changes) == (rows, 7, 0, 0)
    assert row.km == pytest.approx((s[-1] - s[0]) / 1000.0)
    gaps = 60.0 - 4.5 - (s - s[0] - 10.0 * np.arange(rows) * 0.1)
    assert row.touching == ((gaps < 0.0) & (gaps > -9.0)).sum()
    found = quantities(resmoothed(driven), driven.who)
    assert set(found) == set(QUANTITIES)
    assert found["accel_mps2"].x == pytest.approx(np.ones(len(found["accel_mps2"].x)), abs=0.02)
    assert np.abs(found["jerk_mps3"].x).max() < 0.1
    assert set(found["speed_mps"].vehicle) == {1}
    # the recorded scene is untouched, and the other vehicle replays
    assert recorded.speed[60, 0] == 10.0
    assert driven.scene.station[:, 1] == pytest.approx(window_of(recorded, 20, rows).station[:, 1])


def test_a_vehicle_beyond_the_road_s_edge_is_off_the_road():
    out = scene([[50.0]] * 3, [[7.0], [7.5], [-7.5]], [[5.0]] * 3)
    (row,) = counts(out, np.array([0]), np.zeros((3, 1)))
    assert row.off_road == 2


def test_distances_are_zero_for_alike_and_known_for_shifted_samples():
    rng = np.random.default_rng(1)
    who = np.arange(4000) % 40
    data = Values(rng.normal(0.0, 1.0, 4000), who)
    same = distances(data, data, rng)
    assert same["wasserstein"] == 0.0
    assert same["jensen_shannon"] == 0.0
    moved = distances(data, Values(data.x + 0.5, who), rng)
    assert moved["wasserstein"] == pytest.approx(0.5, abs=1e-3)
    assert 0.1 < moved["jensen_shannon"] < 0.4
    apart = distances(data, Values(data.x + 50.0, who), rng)
    assert apart["jensen_shannon"] > 0.99
    low, high = moved["wasserstein_interval_95"]
    assert low < 0.5 < high


def test_histograms_keep_what_lies_outside():
    data = Values(np.linspace(0.0, 1.0, 1001), np.zeros(1001))
    edges = bins(data)
    shares = histogram(Values(np.array([-5.0, 0.5, 9.0, 9.0]), np.zeros(4)), edges)
    assert shares.sum() == pytest.approx(1.0)
    assert (shares[0], shares[-1]) == (0.25, 0.5)


def test_the_bootstrap_draws_vehicles():
    """Rows of a vehicle are copies: the interval must be that of the vehicles' means, however many rows there are."""
    rng = np.random.default_rng(2)
    level = rng.normal(0.0, 1.0, 50)
    x, who = np.repeat(level, 100), np.repeat(np.arange(50), 100)
    low, high = vehicle_bootstrap(who, lambda w: float(np.average(x, weights=w)), rng, 400)
    assert high - low == pytest.approx(4.0 * level.std() / np.sqrt(50), rel=0.25)
    found = root_mean_square(x, who, rng)
    assert found["rms"] == pytest.approx(np.sqrt(np.mean(level**2)), abs=1e-3)
    assert found["rms_interval_95"][0] < found["rms"] < found["rms_interval_95"][1]
    assert found["mean"] == pytest.approx(np.abs(level).mean(), abs=1e-3)


def test_a_rate_is_a_ratio_of_sums():
    found = rate(
        np.array([1.0, 0.0, 2.0]), np.array([10.0, 50.0, 40.0]), np.arange(3), np.random.default_rng(1)
    )
    assert found["value"] == pytest.approx(0.03)
    assert (found["count"], found["of"]) == (3, 100.0)
