"""The command line as users call it: real processes, real SUMO, the trained weights that are shipped."""

import json
import shutil
import signal
import subprocess
import sysconfig
from pathlib import Path
from xml.etree import ElementTree

import cv2
import polars as pl
import pytest
from click.testing import CliRunner

from service.front.cli import main

TAILROAD = shutil.which("tailroad", path=sysconfig.get_path("scripts")) or "tailroad"


def run(folder: Path, *arguments: str, expect: int = 0) -> subprocess.CompletedProcess[str]:
    done = subprocess.run(
        [TAILROAD, *arguments],
        cwd=folder,
        capture_output=True,
        text=True,
        timeout=240,
        stdin=subprocess.DEVNULL,
    )
    assert done.returncode == expect, f"{arguments}: {done.returncode}\n{done.stdout}\n{done.stderr}"
    return done


SMALL = ("--gamma", "1.5", "--budget", "1000", "--workers", "2", "--seed", "5", "--no-report", "--json")


def test_estimate_compares_naive_monte_carlo_and_the_cross_entropy_method(tmp_path: Path) -> None:
    done = run(tmp_path, "estimate", "i80-paper-10s", "--ego", "lidar", "--method", "naive", "--method", "ce",
               "--rho", "0.1", *[a for a in SMALL if a != "--no-report"], "--out", "both")  # fmt: skip
    result = json.loads(done.stdout)
    naive, ce = result["estimates"]
    assert (naive["method"], ce["method"]) == ("naive", "ce")
    for estimate in (naive, ce):
        assert estimate["ci"][0] <= estimate["p"] <= estimate["ci"][1]
        assert estimate["rollouts"]["total"] == 1000
        assert estimate["rollouts"]["failed"] == 0
        assert estimate["sim_s"] > 0
        assert estimate["x_realtime_per_core"] > 0
    assert naive["rollouts"]["training"] == 0
    assert ce["rollouts"]["training"] + ce["rollouts"]["estimation"] == 1000
    assert naive["p"] == naive["events"] / 1000
    assert {"ratio_of_rare_events", "ratio_of_variances", "efficiency"} <= result["comparison"][0].keys()
    assert json.loads((tmp_path / "both" / "result.json").read_text()) == result
    page = (tmp_path / "both" / "report.html").read_text(encoding="utf-8")
    assert "lidar" in page
    assert "</html>" in page


def test_an_interrupted_estimate_is_continued_to_the_same_result(tmp_path: Path) -> None:
    smaller = ["300" if word == "1000" else word for word in SMALL]
    command = ("estimate", "i80-paper-10s", "--ego", "idm", "--method", "naive", *smaller)
    whole = json.loads(run(tmp_path, *command, "--out", "whole").stdout)
    with subprocess.Popen(
        [TAILROAD, *command, "--out", "broken"],
        cwd=tmp_path,
        stderr=subprocess.PIPE,
        stdout=subprocess.DEVNULL,
        text=True,
    ) as process:
        assert process.stderr is not None
        for line in process.stderr:
            if "rollouts on 2 workers" in line:  # the job has begun
                process.send_signal(signal.SIGINT)
                break
        process.stderr.read()
        assert process.wait(timeout=60) == 130
    run(tmp_path, *command, "--out", "broken", expect=2)  # a run is never overwritten
    continued = json.loads(run(tmp_path, "estimate", "--resume", "broken", "--no-report", "--json").stdout)
    for key in ("p", "std_error", "ci", "events", "rollouts"):
        assert continued[key] == whole[key]


def test_a_precision_that_the_budget_does_not_reach_is_exit_code_3(tmp_path: Path) -> None:
    done = run(tmp_path, "estimate", "i80-paper-10s", "--ego", "idm", "--method", "naive", "--gamma", "0.1",
               "--budget", "50",
               "--rel-error", "0.01", "--workers", "1", "--json", "--no-report", expect=3)  # fmt: skip
    assert json.loads(done.stdout)["converged"] is False


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (("estimate", "--gamma", "nan"), "finite"),
        (("estimate",), "--gamma"),
        (("estimate", "--ego", "nobody", "--gamma", "1"), "nobody"),
        (("estimate", "no-such-scenario", "--gamma", "1"), "no-such-scenario"),
        (("estimate", "--gamma", "1", "--budget", "0"), "budget"),
        (("estimate", "--gamma", "1", "--method", "ce", "--budget", "500"), "budget"),
        (("estimate", "--resume", "."), "run.json"),
        (("rollout", "i80-paper-10s", "--video", "film.avi"), ".mp4"),
        (("rollout", "i80-paper-10s", "--trace", "missing/trace.parquet"), "missing"),
        (("scenario", "show", "i81"), "i80"),
        (("nets", "check", "nowhere.net.xml"), "nowhere.net.xml"),
    ],
)
def test_bad_input_is_exit_code_2_and_one_clear_text(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, arguments: tuple[str, ...], told: str
) -> None:
    """In this process: a start takes longer than all of them. The next test starts one."""
    monkeypatch.chdir(tmp_path)
    done = CliRunner().invoke(main, arguments)
    assert done.exit_code == 2, done.output
    assert isinstance(done.exception, SystemExit)
    assert told in done.stderr
    assert list(tmp_path.iterdir()) == []


def test_a_process_that_was_given_bad_input_ends_with_2_and_without_a_traceback(tmp_path: Path) -> None:
    done = run(tmp_path, "estimate", "--ego", "nobody", "--gamma", "1", expect=2)
    assert "nobody" in done.stderr
    assert "Traceback" not in done.stderr
    assert list(tmp_path.iterdir()) == []


def test_a_rollout_is_the_same_twice_and_can_be_seen_in_every_way(tmp_path: Path) -> None:
    command = ("rollout", "i80-paper-10s", "--ego", "lidar", "--seed", "7", "--json")
    first = json.loads(run(tmp_path, *command).stdout)
    again = json.loads(
        run(tmp_path, *command, "--video", "film.mp4", "--trace", "t.parquet", "--fcd", "fcd.xml").stdout
    )
    assert again == first
    film = cv2.VideoCapture(str(tmp_path / "film.mp4"))
    assert film.get(cv2.CAP_PROP_FRAME_COUNT) == first["steps"] + 1
    good, image = film.read()
    assert good
    assert image.std() > 10
    table = pl.read_parquet(tmp_path / "t.parquet")
    assert table["time_s"].n_unique() == first["steps"] + 1
    assert table["ttc_s"].min() == first["f"]
    steps = ElementTree.parse(tmp_path / "fcd.xml").getroot().findall("timestep")
    assert {v.get("id") for v in steps[5]} == {"ego", "env1", "env2", "env4", "env5", "env6"}


def test_scenarios_are_listed_shown_and_checked(tmp_path: Path) -> None:
    listed = json.loads(run(tmp_path, "scenario", "list", "--json").stdout)
    assert {s["name"] for s in listed} >= {"i80", "i80-10s", "i80-paper-10s"}
    (tmp_path / "mine.toml").write_text(run(tmp_path, "scenario", "show", "i80").stdout)
    assert "mine.toml: good" in run(tmp_path, "scenario", "check", "mine.toml").stdout
    broken = (tmp_path / "mine.toml").read_text().replace("speed_mps", "speed_kmh")
    (tmp_path / "mine.toml").write_text(broken)
    told = run(tmp_path, "scenario", "check", "mine.toml", expect=2).stderr
    assert "mine.toml" in told
    assert "speed_kmh" in told
    assert "speed_mps" in told


def test_the_road_passes_its_check_and_can_be_drawn(tmp_path: Path) -> None:
    assert json.loads(run(tmp_path, "nets", "check", "--json").stdout)["passed"] is True
    run(tmp_path, "nets", "plot", "i80", "road.png")
    assert (tmp_path / "road.png").stat().st_size > 10_000


def test_bench_measures_the_world_beside_the_bare_sumo_loop(tmp_path: Path) -> None:
    done = run(tmp_path, "bench", "--ego", "idm", "--rollouts", "5", "--memory-rollouts", "200", "--json")
    result = json.loads(done.stdout)
    measured = result["egos"]["idm"]
    assert measured["ratio_to_bare"] > 1.0  # the bare loop is a part of it
    assert measured["x_realtime"] > 0
    assert set(measured["parts_us_per_step"]) == {
        "sumo", "observation", "camera", "policies", "dynamics", "safety", "noise", "rest"
    }  # fmt: skip
    assert measured["ways"]["sumo"]["share_in_sumo"] == 1.0
    assert measured["ways"]["compiled"]["share_in_sumo"] < 0.5
    assert all(way["processor_us_per_step"] > 0.0 for way in measured["ways"].values())
    assert measured["parts_us_per_step"]["camera"] == 0.0  # it does not look
    assert measured["x_realtime_of_processor"] > 0
    assert result["memory"]["after_all_mb"] > 0
