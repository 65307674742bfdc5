"""Weights files: what is shipped, and what is refused."""

import json

import numpy as np
import pytest
from safetensors.numpy import load_file, save_file

from policies import layout as O
from policies.drivers import WEIGHTS_FOLDER, DriverModel, WeightsError, load_drivers, save_drivers, shipped
from policies.network import forward

CARD_KEYS = {
    "name", "what", "method", "command", "seed", "arguments", "data", "expert", "action_scale", "metrics",
    "limits", "versions",
}  # fmt: skip


def arrays(seed: int = 0) -> dict[str, np.ndarray]:
    rng = np.random.default_rng(seed)
    factor = rng.normal(0.0, 0.01, (O.HEAD_SIZE, 20))
    return {
        "w1": rng.normal(0.0, 0.1, (O.OBSERVATION_SIZE, O.HIDDEN_1)),
        "b1": np.zeros(O.HIDDEN_1),
        "w2": rng.normal(0.0, 0.1, (O.HIDDEN_1, O.HIDDEN_2)),
        "b2": np.zeros(O.HIDDEN_2),
        "mu0": rng.normal(0.0, 0.1, O.HEAD_SIZE),
        "sigma0": factor @ factor.T + 1e-4 * np.eye(O.HEAD_SIZE),
        "action_scale": np.array([1.0, 0.05]),
    }


def test_what_is_saved_is_loaded(tmp_path):
    given = arrays()
    path = save_drivers(tmp_path / "mine.safetensors", given, {"name": "mine"})
    model = load_drivers(path)
    assert isinstance(model, DriverModel)
    for key, value in given.items():
        assert np.allclose(getattr(model, key), value, rtol=1e-6), key
    assert np.array_equal(model.sigma0, given["sigma0"])
    assert model.card == {"name": "mine"}
    with pytest.raises(ValueError, match="read-only"):
        model.w1[0, 0] = 1.0


@pytest.mark.parametrize("name", ["drivers-gail", "drivers-bc", "ego-lidar"])
def test_shipped_weights_load_and_their_card_is_complete(name):
    assert name in shipped()
    model = load_drivers(name)
    assert set(model.card) >= CARD_KEYS
    assert model.card["name"] == name
    assert model.card["metrics"]
    assert model.card["limits"]
    assert np.allclose(model.card["action_scale"], model.action_scale)
    assert str(model.card["seed"]) in model.card["command"]
    for suffix in (".safetensors", ".json"):
        assert (WEIGHTS_FOLDER / f"{name}{suffix}").stat().st_size < 1_000_000
    text = (WEIGHTS_FOLDER / f"{name}.json").read_text()
    assert "/work" not in text
    assert "/home" not in text


@pytest.mark.parametrize("name", ["drivers-gail", "drivers-bc"])
def test_sigma0_of_the_drivers_is_symmetric_positive_definite(name):
    model = load_drivers(name)
    assert np.array_equal(model.sigma0, model.sigma0.T)
    eigenvalues = np.linalg.eigvalsh(model.sigma0)
    assert eigenvalues[0] > 0.0
    card = model.card["sigma0"]
    assert eigenvalues[-1] / eigenvalues[0] == pytest.approx(card["condition_number"], rel=1e-2)
    assert 0.001 < np.median(np.sqrt(np.diag(model.sigma0))) < 0.2


def test_flags_do_not_reach_the_cloned_drivers():
    """They were trained before the flags told of neighbouring lanes: their weights are zero."""
    model = load_drivers("drivers-bc")
    assert not model.w1[O.LANE_TO_THE_LEFT : O.INCIDENT + 1].any()


def free_road(speed: float, offset: float, heading: float = 0.0) -> np.ndarray:
    seen = np.zeros(O.OBSERVATION_SIZE)
    seen[O.LANE_OFFSET_M], seen[O.LANE_HEADING_RAD], seen[O.SPEED_MPS] = offset, heading, speed
    seen[O.LENGTH_M], seen[O.WIDTH_M] = 4.5, 1.8
    seen[O.LEFT_MARKING_M], seen[O.RIGHT_MARKING_M] = 1.83 - offset, 1.83 + offset
    seen[O.RANGE_M : O.RANGE_M + O.BEAMS] = O.LIDAR_RANGE_M
    return seen


@pytest.mark.parametrize("name", ["drivers-gail", "drivers-bc", "ego-lidar"])
def test_shipped_networks_steer_back_and_brake(name):
    model = load_drivers(name)
    outputs = np.zeros(4, np.float32)

    def act(seen):
        forward(seen, model.w1, model.b1, model.w2, model.b2, model.mu0.astype(np.float32), outputs)
        return outputs[:2] * model.action_scale

    assert act(free_road(15.0, 0.8))[1] < act(free_road(15.0, 0.0))[1] < act(free_road(15.0, -0.8))[1]
    assert act(free_road(15.0, 0.0, 0.05))[1] < act(free_road(15.0, 0.0, -0.05))[1]
    behind = free_road(15.0, 0.0)
    behind[O.RANGE_M], behind[O.RANGE_RATE_MPS] = 15.0, -5.0
    assert act(behind)[0] < -0.5
    assert act(behind)[0] < act(free_road(15.0, 0.0))[0]


def test_the_drivers_go_on_into_a_clear_lane_only():
    """Moving left at 0.9 m/s, 0.9 m left of the lane's middle: next to a clear lane, a taken one, and the edge."""
    model = load_drivers("drivers-gail")
    outputs = np.zeros(4, np.float32)

    def turn(seen):
        forward(seen, model.w1, model.b1, model.w2, model.b2, model.mu0.astype(np.float32), outputs)
        return outputs[1] * model.action_scale[1]

    edge = free_road(15.0, 0.9, 0.06)
    clear, taken = edge.copy(), edge.copy()
    clear[O.LANE_TO_THE_LEFT : O.LANE_TO_THE_RIGHT + 1] = 1.0
    taken[O.LANE_TO_THE_LEFT : O.LANE_TO_THE_RIGHT + 1] = 1.0
    taken[O.RANGE_M + 3 : O.RANGE_M + 8] = [2.30, 1.96, 1.86, 1.96, 2.30]
    assert turn(clear) > turn(taken) + 0.01
    assert turn(clear) > turn(edge) + 0.02


def test_an_unknown_name_lists_what_there_is():
    with pytest.raises(WeightsError, match="no shipped weights are called 'nobody'; there are"):
        load_drivers("nobody")


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(WeightsError, match="no such weights file"):
        load_drivers(tmp_path / "x.safetensors")


def test_broken_files_are_refused(tmp_path):
    path = tmp_path / "x.safetensors"
    path.write_bytes(b"nonsense")
    with pytest.raises(WeightsError, match="not a readable safetensors file"):
        load_drivers(path)


def broken(path, change):
    save_drivers(path, arrays(), {"name": "x"})
    stored = load_file(path)
    change(stored)
    save_file(stored, path)
    return path


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda a: a.pop("w2"), "arrays \\['w2'\\] are missing"),
        (
            lambda a: a.update(w1=np.zeros((50, 200), np.float32)),
            r"w1 has shape \(50, 200\), expected \(51, 200\)",
        ),
        (lambda a: a.update(mu0=np.full(404, np.nan)), "mu0 holds values that are not finite"),
        (lambda a: a.update(action_scale=np.array([1.0, 0.0])), "action_scale must be positive"),
        (lambda a: a.update(sigma0_lower=np.zeros(5)), "sigma0_lower has shape"),
        (lambda a: a.update(sigma0_lower=-a["sigma0_lower"]), "sigma0 is not positive definite"),
    ],
)
def test_wrong_arrays_are_refused(tmp_path, change, message):
    with pytest.raises(WeightsError, match=message):
        load_drivers(broken(tmp_path / "x.safetensors", change))


def test_weights_without_a_readable_card_are_refused(tmp_path):
    path = save_drivers(tmp_path / "x.safetensors", arrays(), {"name": "x"})
    card = path.with_suffix(".json")
    card.write_text("{")
    with pytest.raises(WeightsError, match="not valid JSON"):
        load_drivers(path)
    card.write_text(json.dumps([1]))
    with pytest.raises(WeightsError, match="expected a JSON object"):
        load_drivers(path)
    card.unlink()
    with pytest.raises(WeightsError, match=r"its card x\.json is missing"):
        load_drivers(path)
