"""Egos that are networks in files of the user's: their signature, whose file may be read, and rollouts."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest
from click.testing import CliRunner

from policies import layout
from policies.drivers import WeightsError
from policies.egos.onnx_file import OnnxEgo
from service.errors import InputError
from service.evaluation.job import make_job
from service.front.cli.main import main
from service.world.egos.open import check_ego, open_ego
from service.world.egos.settings import EgoSettings
from service.world.scenario import load_scenario

onnx = pytest.importorskip("onnx", reason="networks are made by the package onnx")


@pytest.fixture
def network(tmp_path):
    """network(...): a file whose action is -0.1 x the observation's speed, and -0.2 x its heading in the lane."""

    def make(inputs=None, output=("action", (1, 2)), name="mine.onnx"):
        helper, kinds = onnx.helper, onnx.TensorProto
        given = inputs or {"observation": (kinds.FLOAT, (1, layout.OBSERVATION_SIZE))}
        weights = np.zeros((layout.OBSERVATION_SIZE, 2), np.float32)
        weights[layout.SPEED_MPS, 0], weights[layout.LANE_HEADING_RAD, 1] = -0.1, -0.2
        first = next(iter(given))
        graph = helper.make_graph(
            [helper.make_node("MatMul", [first, "weights"], [output[0]])],
            "mine",
            [helper.make_tensor_value_info(key, *value) for key, value in given.items()],
            [helper.make_tensor_value_info(output[0], kinds.FLOAT, output[1])],
            [onnx.numpy_helper.from_array(weights, "weights")],
        )
        path = tmp_path / name
        model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 13)], ir_version=8)
        onnx.save(model, str(path))
        return path

    return make


def test_it_drives_as_the_network_says(network, tmp_path, monkeypatch):
    path = network()
    monkeypatch.setenv("TAILROAD_ONNX_EGOS", "")
    command = [
        "rollout",
        "i80-paper-10s",
        "--ego",
        f"onnx:{path}",
        "--trace",
        str(tmp_path / "t.parquet"),
        "--json",
    ]
    done = CliRunner().invoke(main, command)
    assert done.exit_code == 0, done.output
    told = json.loads(done.output)
    import polars as pl

    speed = pl.read_parquet(tmp_path / "t.parquet").filter(pl.col("vehicle") == "ego")["speed_mps"].to_numpy()
    assert told["steps"] > 20
    assert speed[1:] / speed[:-1] == pytest.approx(np.full(len(speed) - 1, 0.99), abs=1e-5)


def test_only_files_that_were_named_to_this_process_are_read(network, monkeypatch):
    path = network()
    monkeypatch.setenv("TAILROAD_ONNX_EGOS", "")
    scenario = load_scenario("i80-paper-10s")
    for name in (f"onnx:{path}", "onnx:/etc/passwd", "onnx:"):
        with pytest.raises(InputError, match="is not a file that this process may read"):
            check_ego(name)
        with pytest.raises(InputError, match="is not a file that this process may read"):
            make_job(scenario, name, 0.5, "naive", 1, {})  # as a job that came over the network would
    settings = EgoSettings(onnx=frozenset({str(path)}))
    assert EgoSettings.from_environment(settings.as_environment()) == settings
    assert isinstance(open_ego(f"onnx:{path}", scenario, None, settings), OnnxEgo)


def test_a_job_knows_the_file_by_its_contents(network, monkeypatch):
    path = network()
    monkeypatch.setenv("TAILROAD_ONNX_EGOS", str(path))
    scenario = load_scenario("i80-paper-10s")
    first = make_job(scenario, f"onnx:{path}", 0.5, "naive", 1, {})
    network(output=("action", (1, 2)))
    assert make_job(scenario, f"onnx:{path}", 0.5, "naive", 1, {}).ego_sha256 == first.ego_sha256 != ""
    path.write_bytes(path.read_bytes() + b"\0")
    assert make_job(scenario, f"onnx:{path}", 0.5, "naive", 1, {}).ego_sha256 != first.ego_sha256


WRONG = {
    "another input": ({"x": (1, (1, layout.OBSERVATION_SIZE))}, ("action", (1, 2))),
    "another output": (None, ("control", (1, 2))),
}


@pytest.mark.parametrize("case", WRONG)
def test_another_signature_is_refused_with_the_one_that_is_needed(network, case):
    with pytest.raises(
        WeightsError, match=r"another signature .*it needs an input 'observation' of float32 \(1, 51\)"
    ):
        OnnxEgo(network(*WRONG[case]))


def test_a_file_that_is_no_network_is_refused(tmp_path):
    (tmp_path / "x.onnx").write_bytes(b"no network")
    with pytest.raises(WeightsError, match="no ONNX network that can be run") as refused:
        OnnxEgo(tmp_path / "x.onnx")
    assert "\n" not in str(refused.value)
    with pytest.raises(WeightsError, match="cannot be read: No such file"):
        OnnxEgo(tmp_path / "none.onnx")
    done = CliRunner().invoke(main, ["rollout", "i80-paper-10s", "--ego", f"onnx:{tmp_path / 'none.onnx'}"])
    assert done.exit_code == 2
    assert "no such file" in done.output


def test_numbers_that_are_none_fail_the_rollout_and_not_the_run(network):
    class Broken(OnnxEgo):
        pass

    ego = Broken(network())
    observation = type("Seen", (), {"vector": np.full(layout.OBSERVATION_SIZE, np.nan), "frame": None})()
    assert all(math.isnan(value) for value in ego.act(observation))
