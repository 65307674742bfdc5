"""`tailroad prevent` and `tailroad severity` on a run with contacts."""

import json
import shutil
import sqlite3
from pathlib import Path

import cv2
import msgspec
import pytest
from click.testing import CliRunner, Result

import tailroad
from service.analysis.prevention.objects import Prevention
from service.analysis.severity.objects import Severity
from service.analysis.video.film import HEIGHT, WIDTH
from service.front.cli.main import main


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Starts close to each other, so that a handful of rollouts has contacts; drivers as the paper's."""
    return tailroad.estimate(
        "i80-paper-10s", ego="lidar-paper", gamma=0.0, method="naive", budget=700, seed=1, measure="ttc-impact",
        out=tmp_path_factory.mktemp("verdict") / "run", workers=2,
    ).path  # fmt: skip


def tell(*words: str | Path) -> Result:
    return CliRunner().invoke(main, [str(word) for word in words])


def test_severity_is_told_and_printed(run: Path):
    answer = tell("severity", run, "--json", "--delta-v", "0", "--delta-v", "1", "--workers", "1")
    assert answer.exit_code == 0, answer.output
    found = msgspec.convert(json.loads(answer.stdout), Severity)
    assert found.contact.events == found.events >= 1
    assert found.at_least[0].p == found.contact.p >= found.at_least[1].p
    assert found.injury.ci[0] <= found.injury.p <= found.injury.ci[1] <= found.contact.ci[1]
    assert found.injury.p == pytest.approx(found.contact.p * found.injury.given_contact)
    assert [hit.ego.injury for hit in found.contacts] == sorted(
        (hit.ego.injury for hit in found.contacts), reverse=True
    )
    for hit in found.contacts:
        assert -hit.f == pytest.approx(hit.contact.speed_mps)
    printed = tell("severity", run, "--workers", "1").output
    assert "serious injury" in printed


def test_an_older_record_says_that_contacts_are_not_recorded_and_comes_to_the_same_severity(
    run: Path, tmp_path: Path
):
    """Contacts on record are those that are found by running the rollouts again."""
    older = tmp_path / "older"
    shutil.copytree(run, older)
    with sqlite3.connect(older / "rollouts.sqlite") as connection:
        connection.execute("UPDATE chunks SET contacts = NULL, checksum = ''")
    connection.close()
    kept, again = (
        json.loads(tell("severity", path, "--json", "--workers", "1").stdout) for path in (run, older)
    )
    assert (kept.pop("from_record"), again.pop("from_record")) == (True, False)
    del kept["run"], again["run"]
    for told in (kept, again):
        for hit in told["contacts"]:
            del hit["mode"]  # of groups among those run again
    assert kept == again
    sides = {kind["name"] for kind in _collision(run)["contacts"]}
    assert sides
    assert all(name.startswith("the ego's") for name in sides)
    assert {kind["name"] for kind in _collision(older)["contacts"]} == {"sides not recorded"}


def test_contacts_at_a_speed_or_more_come_from_the_same_run(run: Path):
    estimate = tailroad.resume(run, workers=1).estimate
    impacts = estimate.impacts
    assert [impact.mps for impact in impacts] == [0.0, 1.0, 2.0, 3.0, 4.0, 5.0]
    assert (impacts[0].p, impacts[0].ci, impacts[0].rollouts) == (estimate.p, estimate.ci, estimate.events)
    f = tailroad.resume(run, workers=1).to_polars()["f"]
    assert [impact.rollouts for impact in impacts] == [int((f <= -v).sum()) for v in range(6)]
    assert all(impact.ci[0] <= impact.p <= impact.ci[1] for impact in impacts)


def _collision(run: Path) -> dict:
    endings = tailroad.resume(run, workers=1).estimate.endings
    return next(msgspec.to_builtins(e) for e in endings if e.outcome == "collision")


def test_a_heavier_other_is_worse(run: Path):
    light = json.loads(tell("severity", run, "--json", "--workers", "1").stdout)
    masses = [f"--mass={name}=40000" for name in light["masses_kg"] if name != "ego"]
    heavy = json.loads(tell("severity", run, "--json", "--workers", "1", *masses).stdout)
    assert heavy["injury"]["p"] > light["injury"]["p"]
    assert heavy["other_injury"]["p"] < light["other_injury"]["p"]


def test_prevention_is_told_and_printed(run: Path):
    answer = tell("prevent", run, "--reference", "fsm", "--onset-ttc", "start", "--json", "--workers", "1")
    assert answer.exit_code == 0, answer.output
    found = msgspec.convert(json.loads(answer.stdout), Prevention)
    assert found.onset_ttc_s is None
    assert all(rollout.onset is not None and rollout.onset.step == 0 for rollout in found.rollouts)
    printed = tell("prevent", run, "--reference", "fsm", "--workers", "1").output
    assert "preventable share" in printed


def test_both_drives_are_filmed_one_above_the_other(run: Path, tmp_path: Path):
    film = tmp_path / "both.mp4"
    answer = tell("prevent", run, "--reference", "fsm", "--video", film)
    assert answer.exit_code == 0, answer.output
    assert "with fsm from" in answer.output
    read = cv2.VideoCapture(str(film))
    assert (read.get(cv2.CAP_PROP_FRAME_WIDTH), read.get(cv2.CAP_PROP_FRAME_HEIGHT)) == (WIDTH, 2 * HEIGHT)
    assert read.get(cv2.CAP_PROP_FRAME_COUNT) > 10
    assert tell("prevent", run, "--video", film, "--rank", "10000").exit_code == 2


def test_the_report_tells_severity_and_what_was_found_before(run: Path, tmp_path: Path):
    kept = json.loads(tell("prevent", run, "--reference", "fsm", "--json", "--workers", "1").stdout)
    page = tailroad.resume(run, workers=1).report(tmp_path / "report.html")
    facts = json.loads(page.with_suffix(".json").read_text())
    assert facts["prevention"]["references"] == kept["references"]
    assert facts["severity"]["contact"]["events"] >= 1
    assert "Preventable share of each failure mode" in page.read_text()


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (("prevent", "--reference", "r157"), "r157"),
        (("prevent", "--onset-ttc", "-1"), "above 0"),
        (("severity", "--mass", "ego"), "VEHICLE=KG"),
        (("severity", "--mass", "nobody=1"), "nobody"),
    ],
)
def test_bad_input_is_told_in_a_sentence(run: Path, words: tuple[str, ...], says: str):
    answer = tell(words[0], run, *words[1:])
    assert answer.exit_code == 2
    assert says in answer.output
    assert "Traceback" not in answer.output
