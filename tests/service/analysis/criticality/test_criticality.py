"""Measures of criticality: closed forms, other libraries where they are installed, and a real run."""

import json
import math
import os
import subprocess
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

import tailroad
from service.analysis.criticality.over_time import exposed
from service.analysis.criticality.pair import (
    BRAKE_MPS2,
    STEER_MPS2,
    brake_threat_number,
    time_to_brake,
    time_to_manoeuvre,
    time_to_react,
    worst_time_to_collision,
)
from service.front.cli.main import main
from service.world import agents as A
from service.world.safety.rss import safe_distance_along
from service.world.scenario.schema import Rss

LENGTH, WIDTH = 4.5, 1.8


def vehicle(x: float, y: float, speed: float, heading: float = 0.0, length=LENGTH, width=WIDTH) -> np.ndarray:
    row = np.zeros(A.COLUMNS)
    row[[A.X_M, A.Y_M, A.HEADING_RAD, A.SPEED_MPS, A.LENGTH_M, A.WIDTH_M]] = (
        x,
        y,
        heading,
        speed,
        length,
        width,
    )
    row[[A.COS, A.SIN, A.ACTIVE]] = math.cos(heading), math.sin(heading), 1.0
    return row


def behind(gap: float, closing: float, turned: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """The ego `gap` behind another that is slower by `closing`, on a road in direction `turned`."""
    ahead = gap + LENGTH
    other = vehicle(ahead * math.cos(turned), ahead * math.sin(turned), 10.0, turned)
    return vehicle(0.0, 0.0, 10.0 + closing, turned), other


@pytest.mark.parametrize("turned", [0.0, 0.7, math.pi])
@pytest.mark.parametrize(("gap", "closing"), [(20.0, 10.0), (30.0, 8.0), (8.0, 4.0)])
def test_behind_a_slower_vehicle_all_have_closed_forms(gap: float, closing: float, turned: float):
    ego, other = behind(gap, closing, turned)
    assert time_to_brake(ego, other) == pytest.approx(gap / closing - closing / (2.0 * BRAKE_MPS2), abs=0.02)
    assert brake_threat_number(ego, other) == pytest.approx(closing**2 / (2.0 * gap) / BRAKE_MPS2)
    # gap = closing t + a t^2
    worst = (-closing + math.sqrt(closing**2 + 4.0 * 8.0 * gap)) / (2.0 * 8.0)
    assert worst_time_to_collision(ego, other, 8.0) == pytest.approx(worst, abs=1e-3)
    # a side step of the width within what is left
    left = time_to_manoeuvre(ego, other, "left")
    assert left == pytest.approx(gap / closing - math.sqrt(2.0 * WIDTH / STEER_MPS2), abs=0.03)
    assert time_to_react(ego, other) == max(time_to_brake(ego, other), left)


def test_too_late_is_told_apart_from_nothing_to_avoid():
    ego, other = behind(2.0, 15.0)
    assert time_to_react(ego, other) == -math.inf
    assert brake_threat_number(ego, other) > 1.0
    ego, other = behind(20.0, -1.0)
    assert time_to_react(ego, other) == time_to_brake(ego, other) == math.inf
    assert brake_threat_number(ego, other) == 0.0
    beside = vehicle(30.0, 3.6, 5.0)
    assert brake_threat_number(vehicle(0.0, 0.0, 15.0), beside) == 0.0
    assert worst_time_to_collision(vehicle(0.0, 0.0, 15.0), vehicle(0.0, 1.0, 15.0)) == 0.0


def test_full_acceleration_clears_one_who_comes_from_the_side():
    ego = vehicle(0.0, 0.0, 10.0)
    crossing = vehicle(10.0, -10.0, 10.0, math.pi / 2.0)
    assert time_to_brake(ego, crossing) > 0.0
    assert time_to_react(ego, crossing) >= time_to_manoeuvre(ego, crossing, "kick-down")


def test_exposed_times_are_sums_over_states():
    assert exposed(np.array([3.0, 1.5, 1.0, 0.5, math.inf]), 0.1) == (0.3, 0.15)
    assert exposed(np.array([]), 0.1) == (0.0, 0.0)


THEIRS = Path(__file__).parents[3] / "reference" / "other_measures"
PYTHON = os.environ.get("TAILROAD_MEASURES_PYTHON", "")


@pytest.fixture(scope="module")
def answers() -> dict:
    """What commonroad-crime and ad-rss answer; tests/reference/other_measures/ask.py made it."""
    return json.loads((THEIRS / "answers.json").read_text())


def test_wttc_is_that_of_commonroad_crime(answers: dict):
    """In line, with boxes as long as its circles: their radius is half the length where the width is sqrt(8) / 3 of
    it."""
    assert len(answers["wttc"]) >= 4
    for gap, closing, acceleration, expected in answers["wttc"]:
        ego, other = behind(gap, closing)
        ego[A.WIDTH_M] = other[A.WIDTH_M] = LENGTH * math.sqrt(8.0) / 3.0
        assert worst_time_to_collision(ego, other, acceleration) == pytest.approx(expected, abs=2e-3)


def test_the_safe_distance_is_that_of_ad_rss(answers: dict):
    rss = Rss()
    values = np.array([rss.response_s, rss.acceleration_mps2, rss.least_braking_mps2, rss.hardest_braking_mps2,
                       rss.lateral_acceleration_mps2, rss.lateral_braking_mps2, rss.lateral_margin_m])  # fmt: skip
    assert len(answers["safe_distance_along"]) >= 4
    for rear, front, expected in answers["safe_distance_along"]:
        assert safe_distance_along(rear, front, values) == pytest.approx(expected, abs=1e-6)


@pytest.mark.long  # commonroad-crime wants another protobuf than tailroad: see tests/reference/other_measures
def test_the_answers_on_file_are_those_of_the_libraries(answers: dict):
    assert PYTHON, "TAILROAD_MEASURES_PYTHON must name a Python that has commonroad-crime and ad-rss"
    again = subprocess.run([PYTHON, "-W", "ignore", str(THEIRS / "ask.py")], capture_output=True, check=True)
    assert json.loads(again.stdout) == answers


def test_dangerous_rollouts_of_a_run_are_told(tmp_path: Path):
    run = tailroad.estimate(
        "i80-paper-10s", ego="lidar-paper", gamma=1.0, method="naive", budget=300, measure="ttc-impact", workers=1,
        out=tmp_path / "run",
    )  # fmt: skip
    found = run.criticality(limit=3, by="f")
    assert [one.rank for one in found.rollouts] == [1, 2, 3][: found.events]
    for one in found.rollouts:
        assert one.ttc_s is not None
        assert one.wttc_s is not None
        assert one.wttc_s <= one.ttc_s  # the worst that can be
        assert one.tet_s > 0.0
        assert one.tit_s2 <= one.tet_s * found.tau_s
        if one.f > 0.0:
            assert one.ttc_s == pytest.approx(one.f, abs=1e-6)
    answer = CliRunner().invoke(main, ["criticality", str(run.path), "--limit", "2", "--workers", "1"])
    assert answer.exit_code == 0, answer.output
    assert "WTTC" in answer.output
    assert max(len(line) for line in answer.output.splitlines()) <= 80
    told = json.loads(CliRunner().invoke(main, ["criticality", str(run.path), "--limit", "3", "--by", "f", "--json",
                                                "--workers", "1"]).stdout)  # fmt: skip
    assert told["rollouts"][0]["rank"] == 1
