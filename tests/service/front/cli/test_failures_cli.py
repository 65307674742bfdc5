"""failures, replay, compare, report and schema as users call them, on one small comparison of real rollouts."""

import html
import json
from pathlib import Path
from xml.etree import ElementTree

import cv2
import msgspec
import polars as pl
import pytest
from click.testing import CliRunner, Result

from service.analysis.comparison.objects import Comparison
from service.analysis.failures.objects import Failure, Failures
from service.front.cli import main


def run(*arguments: str, expect: int = 0) -> Result:
    done = CliRunner().invoke(main, list(arguments))
    assert done.exit_code == expect, done.output
    return done


@pytest.fixture(scope="module")
def compared(scenario_text, tmp_path_factory) -> tuple[Path, dict]:
    """`tailroad compare` of two egos on the same 30 draws: its folder and what it prints."""
    folder = tmp_path_factory.mktemp("compare")
    (folder / "my.toml").write_text(scenario_text)
    asked = ["--ego", "idm", "--ego", "lidar", "--gamma", "2.5", "--budget", "30", "--workers", "1", "--json"]
    places = ["--out", str(folder / "runs"), "--html", str(folder / "both.html")]
    done = run("compare", str(folder / "my.toml"), *asked, *places)
    return folder, json.loads(done.stdout)


def test_compare_runs_both_on_the_same_draws(compared):
    folder, told = compared
    found = msgspec.convert(told, Comparison)
    assert [(side.ego, side.rollouts) for side in found.sides] == [("idm", 30), ("lidar", 30)]
    (pair,) = found.pairs
    assert pair.difference.paired
    assert pair.draws is not None
    draws = pair.draws
    assert draws.both + draws.only_a + draws.only_b + draws.neither == 30
    assert html.escape(pair.summary) in (folder / "both.html").read_text(encoding="utf-8")


def test_compare_reads_two_runs(compared):
    folder, told = compared
    runs = str(folder / "runs" / "a-idm"), str(folder / "runs" / "b-lidar")
    again = json.loads(run("compare", *runs, "--workers", "1", "--json").stdout)
    assert again["pairs"] == told["pairs"]
    wider = json.loads(
        run("compare", *runs, "--workers", "1", "--gamma", "4", "--examine", "0", "--json").stdout
    )
    assert wider["sides"][0]["p"] > told["sides"][0]["p"]
    printed = run("compare", *runs, "--workers", "1").output
    assert "are dangerous to both" in printed
    refused = run("compare", *runs, "--budget", "20000", "--seed", "1", expect=2).output
    assert "runs have their own budget, seed: leave out --budget, --seed, or name a scenario" in refused


def test_failures_lists_what_replay_brings_back(compared, tmp_path):
    folder, _ = compared
    path = str(folder / "runs" / "a-idm")
    found = msgspec.convert(json.loads(run("failures", path, "--workers", "1", "--json").stdout), Failures)
    assert found.events == len(found.failures) > 0
    files = {
        "--video": tmp_path / "f.mp4",
        "--fcd": tmp_path / "f.xml",
        "--trace": tmp_path / "f.parquet",
        "--scenario": tmp_path / "f.toml",
        "--recording": tmp_path / "f.mcap",
    }
    exports = [word for option, file in files.items() for word in (option, str(file))]
    again = msgspec.convert(json.loads(run("replay", path, "1", *exports, "--json").stdout), Failure)
    assert again.same_to_the_bit
    assert again.noise_seed == found.failures[0].noise_seed
    assert again.motion == found.failures[0].motion
    film = cv2.VideoCapture(str(files["--video"]))
    steps = pl.read_parquet(files["--trace"])["time_s"].n_unique()
    assert film.get(cv2.CAP_PROP_FRAME_COUNT) >= steps
    vehicles = {v.get("id") for v in ElementTree.parse(files["--fcd"]).iter("vehicle")}
    assert "ego" in vehicles
    assert files["--recording"].read_bytes().startswith(b"\x89MCAP")
    told = json.loads(run("rollout", str(files["--scenario"]), "--json").stdout)
    assert told["f"] == again.f
    assert told["same_to_the_bit"]


def test_failures_in_words(compared):
    folder, _ = compared
    printed = run("failures", str(folder / "runs" / "a-idm"), "--workers", "1", "--limit", "2").output
    assert "share of p" in printed
    assert "tailroad replay" in printed


def test_the_report_tells_how_it_fails_and_the_risk(compared, tmp_path):
    folder, _ = compared
    path = str(folder / "runs" / "b-lidar")
    run(
        "report",
        path,
        "--out",
        str(tmp_path),
        "--workers",
        "1",
        "--baseline",
        "2.5",
        "--baseline-source",
        "our fleet",
    )
    facts = json.loads((tmp_path / "report.json").read_text())
    html = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert facts["risk"]["baseline"]["source"] == "our fleet"
    assert facts["risk"]["summary"] in html
    assert sum(m["share"] for m in facts["failure_modes"]["modes"]) == pytest.approx(1.0)
    for mode in facts["failure_modes"]["modes"]:
        assert mode["name"] in html


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("replay", "{run}", "99"), "rank 99"),
        (("failures", "{run}", "--method", "ce"), "has naive"),
        (("replay", "{run}", "1", "--recording", "{folder}/x.rrd"), ".mcap"),
        (("replay", "{run}", "1", "--scenario", "{folder}/none/x.toml"), "does not exist"),
        (("compare", "i80-10s", "--ego", "idm", "--gamma", "1"), "two or more different egos"),
        (("compare", "i80-10s", "--ego", "idm", "--ego", "lidar"), "threshold"),
        (("compare", "{run}", "{run}", "--ego", "idm"), "leave out"),
        (("compare", "{run}", "{run}"), "different runs"),
        (("compare", "{run}"), "two or more"),
        (("report", "{run}", "--baseline", "often"), "events per million km"),
    ],
)
def test_wrong_use_is_told_in_one_sentence(compared, tmp_path, arguments, said):
    folder, _ = compared
    filled = [a.format(run=folder / "runs" / "a-idm", folder=tmp_path) for a in arguments]
    assert said in " ".join(run(*filled, expect=2).output.split())


@pytest.mark.parametrize("name", ["failures", "failure", "comparison", "learned", "report", "risk"])
def test_schemas_are_printed(name):
    schema = json.loads(run("schema", name).stdout)
    assert schema["$defs"]
