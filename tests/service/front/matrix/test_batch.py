"""Batches: the file, the verdicts and their exit codes, and a run by a service."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import pytest
from click.testing import CliRunner

from service.errors import InputError
from service.front.cli.main import main
from service.front.matrix.plan import Cell, cells, read_batch
from service.front.matrix.verdict import exit_code, result_of
from service.remote.api.server import Api
from service.remote.fleet.policy import Policy
from tests.service.remote.fleet.light import LightWorker, light_fleet

TEXT = """format = 1
name = "t"
scenarios = ["i80-paper-10s"]
egos = ["idm"]
gammas = [1.0, 0.5]
methods = ["naive"]
budget = 300
"""


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "batch.toml"
    path.write_text(TEXT, encoding="utf-8")
    return path


def test_cells_are_the_whole_matrix(file: Path) -> None:
    file.write_text(
        TEXT.replace('["idm"]', '["idm", "lidar"]') + "[options.naive]\nbatch_size = 50\n", encoding="utf-8"
    )
    found = list(cells(read_batch(file), file.parent))
    assert [(c.ego, c.gamma) for c in found] == [("idm", 1.0), ("idm", 0.5), ("lidar", 1.0), ("lidar", 0.5)]
    assert all(c.options["batch_size"] == 50 for c in found)
    assert len({c.digest for c in found} | {c.folder for c in found}) == 8


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ("format = 1", "format = 2", "format 2"),
        ('name = "t"', 'name = "../t"', "name"),
        ("[1.0, 0.5]", "[]", "gammas"),
        ("[1.0, 0.5]", "[nan]", "not finite"),
        ("budget = 300", "budgt = 300", "budgt"),
        ("budget = 300", "budget = 300\n[options.ce]\nrho = 0.1", "ce"),
        ("format = 1", "format 1", "TOML"),
    ],
)
def test_wrong_files(file: Path, old: str, new: str, says: str) -> None:
    file.write_text(TEXT.replace(old, new), encoding="utf-8")
    with pytest.raises(InputError, match=says):
        read_batch(file)


def told(
    p: float,
    low: float,
    high: float,
    warnings: tuple[str, ...] = (),
    training: int = 0,
    converged: bool = True,
):
    return {
        "p": p, "std_error": 0.1, "ci": [low, high], "confidence": 0.95, "converged": converged, "events": 3,
        "rollouts": {"total": 9, "training": training, "failed": 0}, "warnings": [{"name": w} for w in warnings],
    }  # fmt: skip


CELL = Cell(scenario="s", ego="e", gamma=0.5, method="ce", options={"rel_error": 0.1}, seed=1)


@pytest.mark.parametrize(
    ("summary", "verdict", "code"),
    [
        (told(0.1, 0.05, 0.15), "below", 0),
        (told(0.1, 0.05, 0.25), "not-below", 1),
        (told(0.4, 0.3, 0.5), "above", 1),
        (told(0.1, 0.05, 0.15, ("heavy-tailed-weights",)), "inconclusive", 4),
        (told(0.0, 0.0, 0.15, ("no-events",)), "below", 0),  # nothing was searched: the bound is exact
        (told(0.0, 0.0, 0.15, ("no-events",), training=5), "inconclusive", 4),
        (told(0.1, 0.05, 0.15, converged=False), "below", 3),
    ],
)
def test_verdicts_and_exit_codes(summary: dict, verdict: str, code: int) -> None:
    result = result_of(CELL, "", "done", "", summary, 0.2)
    assert result.verdict == verdict
    assert exit_code([result]) == code


def test_the_gravest_cell_decides() -> None:
    good, bad = (result_of(CELL, "", "done", "", s, 0.2) for s in (told(0.1, 0.0, 0.1), told(0.3, 0.25, 0.4)))
    lost = result_of(CELL, "", "failed", "no ego", None, 0.2)
    assert exit_code([good, lost]) == 5
    assert exit_code([good, lost, bad]) == 1


def test_a_service_runs_a_batch_once(file: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    with light_fleet(tmp_path, Policy(audit_share=0.0, hold_s=0.5)) as light:
        api = Api(light._session, light.fleet)
        worker = LightWorker(light.port, "w1")
        command = [
            "batch",
            str(file),
            "--connect",
            f"tcp/127.0.0.1:{light.port}",
            "--out",
            str(out),
            "--json",
        ]
        try:
            first = CliRunner().invoke(main, command)
            again = CliRunner().invoke(main, [*command, "--fail-above", "0.001"])
            jobs = light.fleet.jobs()
        finally:
            worker.stop()
            api.close()
    assert first.exit_code == 0, first.output
    assert again.exit_code == 1
    assert len(jobs) == 2  # the second command found them
    written = json.loads((out / "results.json").read_text())
    assert [r["verdict"] for r in written["results"]] == ["above", "above"]
    with (out / "results.csv").open() as rows:
        assert [float(row["p"]) for row in csv.DictReader(rows)] == [r["p"] for r in written["results"]]
