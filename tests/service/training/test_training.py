"""Training: demonstrations, expert, network, ensemble. The regression tests need torch (the extra `train`)."""

from pathlib import Path

import numpy as np
import pytest

from policies import layout as O
from policies.data import scenes as S
from policies.network import forward
from service.training import demonstrations as D
from service.training import ensemble as E
from service.training import expert as X

SAMPLE = Path(S.__file__).parent / "sample"
NO_TORCH = "torch is not installed: pip install 'tailroad[train]' to test the training"


@pytest.fixture(scope="module")
def scene():
    return S.read_i80(SAMPLE / "i80_6s.parquet", SAMPLE / "i80_lanes.json")


@pytest.fixture(scope="module")
def rows(scene):
    return D.recorded_rows(scene)


def test_recorded_rows_show_what_the_driver_was_doing(scene, rows):
    frame, vehicle = np.nonzero(scene.usable)
    assert len(rows) == len(frame)
    assert np.allclose(rows.seen[:, O.SPEED_MPS], scene.speed[frame, vehicle], atol=1e-4)
    assert np.allclose(rows.action[:, 1], scene.turn_rate[frame, vehicle], atol=1e-6)
    width = rows.seen[:, O.LEFT_MARKING_M] + rows.seen[:, O.RIGHT_MARKING_M]
    assert np.allclose(width, scene.road.lane_width_m, atol=1e-3)
    assert not rows.seen[:, O.INCIDENT].any()
    ranges = rows.seen[:, O.RANGE_M : O.RANGE_M + O.BEAMS]
    assert (ranges > 0.0).all()
    assert (ranges[:, 0] < O.LIDAR_RANGE_M).mean() > 0.9


def test_the_range_ahead_is_the_gap_to_the_recorded_leader(scene, rows):
    frame, vehicle = np.nonzero(scene.usable)
    checked = 0
    for i in range(0, len(rows), 97):
        f, v = frame[i], vehicle[i]
        same = (scene.lane[f] == scene.lane[f, v]) & (scene.station[f] > scene.station[f, v])
        ahead = scene.station[f] - scene.station[f, v] - 0.5 * scene.length_m
        nearest = np.where(same, ahead, np.inf).min()
        straight = abs(scene.heading[f, v]) < 0.01 and nearest < 40.0
        j = np.where(same, ahead, np.inf).argmin()
        if straight and abs(scene.lateral[f, j] - scene.lateral[f, v]) < 0.5:
            assert rows.seen[i, O.RANGE_M] == pytest.approx(nearest, abs=0.3)
            checked += 1
    assert checked > 5


def test_perturbed_rows_are_labelled_with_the_way_back(scene, rows):
    perturbed = D.perturbed_rows(scene, np.random.default_rng(1))
    assert len(perturbed) == len(rows)
    shift = perturbed.seen[:, O.LANE_OFFSET_M] - rows.seen[:, O.LANE_OFFSET_M]
    same_lane = np.abs(shift) < 1.0
    steering = (perturbed.action - rows.action)[:, 1]
    assert np.corrcoef(shift[same_lane], steering[same_lane])[0, 1] < -0.3


def test_the_correction_rejoins_the_recorded_motion():
    """Integrated in closed loop, a displaced vehicle is back after five time constants, without overshooting much."""
    state = np.array([[2.0, 0.6, 0.01, 1.0]])
    speed, path = 15.0, []
    for _ in range(150):
        a, w = D.correction(state, np.array([speed]))[0]
        v = speed + state[0, 3]
        state = state + 0.1 * np.array([[state[0, 3], v * np.sin(state[0, 2]), w, a]])
        path.append(state[0].copy())
    path = np.array(path)
    assert abs(path[100:, 1]).max() < 0.05
    assert path[:, 1].min() > -0.1
    assert abs(path[-1, 3]) < 0.1


def test_whole_vehicles_are_held_out(scene):
    held = D.held_out_vehicles(scene)
    assert 0.05 < held.mean() < 0.6
    assert (scene.vehicle_id[held].min() > scene.vehicle_id[~held].max()).all()


def seen_at(speed, gap=np.inf, closing=0.0, offset=0.0):
    seen = np.zeros((1, O.OBSERVATION_SIZE))
    seen[0, O.SPEED_MPS], seen[0, O.LENGTH_M], seen[0, O.LANE_OFFSET_M] = speed, 4.5, offset
    seen[0, O.RANGE_M : O.RANGE_M + O.BEAMS] = O.LIDAR_RANGE_M
    if np.isfinite(gap):
        seen[0, O.RANGE_M], seen[0, O.RANGE_RATE_MPS] = gap + 2.25, -closing
    return seen


def test_the_expert_follows_and_keeps_its_lane():
    expert = X.Expert()
    assert X.leader(seen_at(10.0, 12.0, 3.0)) == (pytest.approx(12.0), pytest.approx(3.0))
    free = X.mean_action(expert, seen_at(10.0))[0]
    assert free[0] > 0.0
    assert free[1] == 0.0
    assert X.mean_action(expert, seen_at(10.0, 8.0, 4.0))[0, 0] < -2.0
    assert abs(X.mean_action(expert, seen_at(expert.desired_speed_mps))[0, 0]) < 1e-9
    assert X.mean_action(expert, seen_at(15.0, offset=0.5))[0, 1] < 0.0


def test_the_experts_noise_gives_the_recorded_spread_across_the_lane():
    expert = X.Expert(lateral_rate_per_s=0.5, offset_sd_m=0.2)
    rng = np.random.default_rng(2)
    speed, y, psi, seen = 15.0, np.zeros(400), np.zeros(400), np.repeat(seen_at(15.0), 400, axis=0)
    history = []
    for step in range(1200):
        seen[:, O.LANE_OFFSET_M], seen[:, O.LANE_HEADING_RAD] = y, psi
        w = X.mean_action(expert, seen)[:, 1] + X.noise_sd(expert, seen)[:, 1] * rng.standard_normal(400)
        y, psi = y + 0.1 * speed * np.sin(psi + 0.05 * w), psi + 0.1 * w
        if step > 300:
            history.append(y)
    assert np.std(history) == pytest.approx(0.2, rel=0.08)


def test_the_expert_is_recovered_from_its_own_driving():
    truth = X.Expert(time_headway_s=1.0, acceleration_mps2=0.9, comfort_mps2=2.0)
    rng = np.random.default_rng(4)
    events, steps = 60, 300
    lead = 10.0 + 2.5 * np.sin(2 * np.pi * (np.arange(steps) / 100.0 + rng.random((events, 1))))
    following = np.full((events, steps, 3), np.nan)
    gap, v = rng.uniform(8.0, 25.0, events), np.full(events, 10.0)
    for k in range(steps):
        following[:, k] = np.column_stack([gap, v, lead[:, k]])
        seen = np.concatenate([seen_at(s, g, s - u) for g, s, u in following[:, k]])
        new = np.maximum(v + 0.1 * X.mean_action(truth, seen)[:, 0], 0.0)
        after = lead[:, min(k + 1, steps - 1)]
        gap, v = gap + 0.05 * (lead[:, k] + after - v - new), new
    speeds = rng.uniform(5.0, 20.0, 3000)
    accel = truth.acceleration_mps2 * (1.0 - (speeds / truth.desired_speed_mps) ** 4) + rng.normal(
        0.0, 0.3, 3000
    )
    lateral = np.tile([100.0, 0.04, 0.01], (30, 1))
    found = X.fit(X.Evidence(following, np.column_stack([speeds, accel]), np.arange(3000), lateral))
    assert found.time_headway_s == pytest.approx(truth.time_headway_s, abs=0.2)
    assert found.acceleration_mps2 == pytest.approx(truth.acceleration_mps2, rel=0.15)
    assert found.desired_speed_mps == pytest.approx(truth.desired_speed_mps, rel=0.1)
    assert found.lateral_rate_per_s == pytest.approx(0.5)
    assert found.offset_sd_m == pytest.approx(0.2)
    assert found.acceleration_noise_mps2 == pytest.approx(0.3, rel=0.1)


def test_a_refitted_head_reaches_the_maximum_of_the_likelihood():
    rng = np.random.default_rng(5)
    h = np.maximum(rng.standard_normal((4_000, O.HIDDEN_2)), 0.0)
    h[:, 6:] = 0.0
    truth = np.zeros((O.HIDDEN_2 + 1, O.OUTPUTS))
    truth[:6] = rng.normal(0.0, 0.3, (6, O.OUTPUTS))
    truth[-1, 2:] = -0.8
    outputs = np.column_stack([h, np.ones(len(h))]) @ truth
    action = outputs[:, :2] + np.exp(outputs[:, 2:]) * rng.standard_normal((len(h), 2))
    head = E.refit_head(h, action, np.ones(len(h)), np.zeros(O.HEAD_SIZE), 1e-6).reshape(-1, O.OUTPUTS)
    assert np.abs(head - truth)[:6].max() < 0.12
    assert np.abs(head - truth)[6:-1].max() == 0.0


def test_the_heads_distribution_is_positive_definite_and_keeps_correlations():
    rng = np.random.default_rng(6)
    shape = 1e-4 * np.eye(101)
    shape[:2, :2] = 1e-2 * np.array([[1.0, -0.98], [-0.98, 1.0]])
    root = np.linalg.cholesky(shape)
    members = np.stack([(root @ rng.standard_normal((101, 4))).reshape(-1) for _ in range(20)])
    found, scores = E.head_distribution(members, [shape] * 4)
    assert np.array_equal(found.covariance, found.covariance.T)
    assert np.linalg.eigvalsh(found.covariance)[0] > 0.0
    assert found.shrinkage == max(scores, key=scores.get)
    total = np.trace(found.covariance) / members.var(axis=0, ddof=1).sum()
    assert 0.7 < total < 1.5
    both = found.covariance[0, 0] + found.covariance[4, 4] + 2.0 * found.covariance[0, 4]
    assert both < 0.2 * found.covariance[0, 0]  # weights 0 and 1 cancel: drivers differ little in their sum
    json_ready = E.describe(found)
    assert json_ready["condition_number"] > 1.0


def test_a_short_training_lowers_the_loss_and_writes_loadable_weights(rows, tmp_path):
    torch = pytest.importorskip("torch", reason=NO_TORCH)
    from policies.drivers import load_drivers, save_drivers
    from service.training import network as N

    torch.manual_seed(0)
    torch.set_num_threads(1)
    net = N.DriverNet(*N.input_statistics(rows.seen))
    sd = np.zeros_like(rows.action)
    losses = N.train(
        net, rows.seen, rows.action, sd, np.ones(len(rows)), 151, np.random.default_rng(0), batch=256
    )
    assert losses[-1] < losses[0] - 0.2
    network = N.exported(net, rows.seen)
    covariance = 1e-4 * np.eye(O.HEAD_SIZE)
    arrays = {**network._asdict(), "mu0": network.head, "sigma0": covariance}
    arrays.pop("head")
    model = load_drivers(save_drivers(tmp_path / "tiny.safetensors", arrays, {"name": "tiny"}))
    assert np.array_equal(model.w1, network.w1)
    activity = N.network_features(network, rows.seen)
    level = np.sqrt((activity**2).mean(axis=0))
    assert np.allclose(level[level > 0.01], 1.0, atol=0.01)


def test_torch_and_compiled_forward_agree(rows):
    torch = pytest.importorskip("torch", reason=NO_TORCH)
    from service.training import network as N

    torch.manual_seed(1)
    net = N.DriverNet(*N.input_statistics(rows.seen))
    network = N.exported(net, rows.seen)
    with torch.no_grad():
        expected = net(torch.as_tensor(rows.seen[::50])).numpy()
    outputs = np.zeros(O.OUTPUTS, np.float32)
    for seen, wanted in zip(rows.seen[::50].astype(np.float64), expected, strict=True):
        forward(seen, network.w1, network.b1, network.w2, network.b2, network.head, outputs)
        assert np.allclose(outputs, wanted, atol=2e-5)
