"""Learned, comparison, risk, report and exports over the API: on jobs whose f a light worker made up."""

from __future__ import annotations

import base64
import json
import tomllib
from pathlib import Path
from xml.etree import ElementTree

import cv2
import jsonschema
import msgspec
import numpy as np
import pytest
import zenoh
from click.testing import CliRunner
from mcap.reader import make_reader

from service.analysis.comparison.objects import Comparison
from service.analysis.coverage.objects import Coverage
from service.analysis.learned.objects import Learned
from service.analysis.prevention.objects import Prevention
from service.analysis.report.objects import Report
from service.analysis.risk import Risk
from service.analysis.severity.objects import Severity
from service.front.cli.main import main
from service.remote.api.schemas import schema_of
from service.remote.client import Client, Refused
from service.world.scenario.load import parse_scenario
from tests.service.remote.api.conftest import ANSWER_S
from tests.service.remote.fleet.light import formula

pytestmark = pytest.mark.timeout(900)  # exports start a process each: long on a busy machine

JOB = {"ego": "idm", "method": "naive", "budget": 60}
GAMMA = 0.5  # an eighth of the made-up values


@pytest.fixture(scope="module")
def jobs(client: Client) -> list[str]:
    """Two jobs of different seeds."""
    found = [client.submit("i80-paper-10s", GAMMA, **JOB, seed=seed).id for seed in (21, 22)]
    for job in found:
        client.wait(job)
    return found


def valid(body: object, kind: type[msgspec.Struct]) -> None:
    jsonschema.validate(json.loads(msgspec.json.encode(body)), schema_of(kind))


def test_what_was_learned(client: Client, jobs: list[str]) -> None:
    found = client.learned(jobs[0], rollouts=4)
    valid(found, Learned)
    estimate = client.estimate(jobs[0])
    assert (found.job, found.source) == (jobs[0], "dangerous rollouts")
    assert found.effective == pytest.approx(estimate.events)
    assert [p.name for p in found.parameters[:4]] == [
        "ego.station_m",
        "ego.lane_offset_m",
        "ego.heading_deg",
        "ego.speed_mps",
    ]
    speed = found.parameters[3]
    assert speed.base.mean == speed.base.q50 == 15.0
    assert speed.proposal is not None
    assert 10.0 <= speed.proposal.q05 <= speed.proposal.q50 <= speed.proposal.q95 <= 20.0
    assert found.rollouts_run_again == (4, min(4, estimate.events))
    assert {b.name for b in found.behaviours} == {
        "lane_changes",
        "hard_brakes",
        "close_following",
        "headway",
        "speed",
    }


def test_what_dangerous_rollouts_come_to(client: Client, jobs: list[str]) -> None:
    severity = client.severity(jobs[0], examine=2)
    valid(severity, Severity)
    estimate = client.estimate(jobs[0])
    assert (severity.job, severity.events) == (jobs[0], estimate.events)
    prevention = client.prevention(jobs[0], reference="fsm", examine=2)
    valid(prevention, Prevention)
    assert [by.reference for by in prevention.references] == ["fsm"]
    assert prevention.examined == min(2, estimate.events)
    coverage = client.coverage(jobs[0])
    valid(coverage, Coverage)
    assert coverage.looked_at == 60
    for one in coverage.attributes:
        assert sum(cell.events for cell in one.cells) == estimate.events
    with pytest.raises(Refused):
        client.prevention(jobs[0], reference="nobody")


def test_comparison(client: Client, jobs: list[str]) -> None:
    found = client.comparison(jobs, examine=0)
    valid(found, Comparison)
    assert [side.run for side in found.sides] == jobs
    (pair,) = found.pairs
    estimates = [client.estimate(job) for job in jobs]
    assert pair.difference.difference == estimates[1].p - estimates[0].p
    assert not pair.difference.paired  # different seeds, and the notes say so
    assert any("not the same draws" in note for note in found.notes)
    wider = client.comparison(jobs, gamma=2 * GAMMA, examine=0)
    assert wider.sides[0].p == client.estimate(jobs[0], gamma=2 * GAMMA).p > found.sides[0].p


def test_risk(client: Client, jobs: list[str]) -> None:
    found = client.risk(jobs[0], baseline=2.5, source="our fleet")
    valid(found, Risk)
    assert found.baseline.source == "our fleet"
    assert found.p == client.estimate(jobs[0]).p
    assert found.per_million_km == pytest.approx(found.p / found.exposure.km * 1e6)
    low, high = found.per_million_km_ci
    assert low < found.per_million_km < high


def test_report(client: Client, jobs: list[str]) -> None:
    html, facts = client.report(jobs[0]), client.report_json(jobs[0])
    valid(facts, Report)
    assert html.startswith("<!DOCTYPE html>")
    assert facts.headline.answer in html
    assert facts.headline.p == client.estimate(jobs[0]).p
    assert facts.run == jobs[0]


def test_a_rollout_to_play_and_to_look_at(client: Client, jobs: list[str]) -> None:
    found = client.rollout(jobs[0], 3, playback=True, camera=2)
    assert found.trace is None
    assert found.playback is not None
    states = len(found.playback.time_s)
    ego = next(track for track in found.playback.tracks if track.role == "ego")
    assert len(ego.station_m) == len(found.playback.ttc_s) == len(found.playback.ray_m) == states
    assert found.playback.road[0].kind == "edge"
    assert found.camera is not None
    assert [picture.state for picture in found.camera] == [0, states - 1]
    for picture in found.camera:
        pixels = cv2.imdecode(np.frombuffer(base64.b64decode(picture.jpeg), np.uint8), cv2.IMREAD_COLOR)
        assert pixels.shape[1] == 480
        assert pixels.std() > 10.0  # it shows something


def test_a_rollout_that_chains_met_is_one_of_the_estimate(service, client: Client) -> None:
    job = client.submit("i80-paper-10s", 0.5, ego="idm", method="splitting", budget=1000, seed=23).id
    client.wait(job)
    record = service.light.fleet.record(job)
    (phase, iteration, row), (_, noise_seed, f) = next(
        item for item in record.explicit.items() if item[1][2] <= 0.5
    )
    found = client.rollout(job, row, iteration=iteration)
    assert (found.phase, found.noise_seed, found.f, found.dangerous) == (phase, str(noise_seed), f, True)
    listed = client.listing(job, phase="train", low=0.6, by="-f")
    last = max(range(len(listed.row)), key=lambda i: listed.iteration[i])  # of the chains, after many draws
    assert (listed.phase[last], listed.iteration[last], listed.row[last]) not in record.explicit
    found = client.rollout(job, listed.row[last], iteration=listed.iteration[last])
    assert not found.dangerous
    f, _ = formula(np.array([int(found.noise_seed)], np.uint64))
    assert f[0] == found.f == listed.f[last]  # it is the draw that was answered


def test_exports_open_in_their_readers(client: Client, jobs: list[str], tmp_path: Path) -> None:
    scenario = parse_scenario(
        tomllib.loads(client.export(jobs[0], 3, "scenario").decode()), "rollout 3", Path()
    )
    assert scenario.fixed is not None
    assert scenario.fixed.noise_seed == client.rollout(jobs[0], 3).noise_seed
    fcd = ElementTree.fromstring(client.export(jobs[0], 3, "fcd"))
    assert {"ego", "env1"} <= {vehicle.get("id") for vehicle in fcd.iter("vehicle")}
    recording = tmp_path / "r.mcap"
    recording.write_bytes(client.export(jobs[0], 3, "mcap"))
    with recording.open("rb") as stream:
        summary = make_reader(stream).get_summary()
    assert summary is not None
    assert summary.statistics is not None
    assert summary.statistics.message_count > 100


def test_a_file_comes_with_its_media_type(service, jobs: list[str], client: Client) -> None:
    client.export(jobs[0], 3, "scenario")  # computed
    config = zenoh.Config()
    config.insert_json5("mode", '"client"')
    config.insert_json5("connect/endpoints", f'["tcp/127.0.0.1:{service.port}"]')
    with zenoh.open(config) as session:
        selector = f"tailroad/v1/jobs/{jobs[0]}/rollouts/3/export?format=scenario"
        (reply,) = session.get(selector, timeout=ANSWER_S)
        assert str(reply.ok.encoding) == "application/toml"


def test_commands_fetch_reports_and_files(service, jobs: list[str], tmp_path: Path) -> None:
    endpoint = f"tcp/127.0.0.1:{service.port}"
    out = tmp_path / "report"
    done = CliRunner().invoke(main, ["report", jobs[0], "--connect", endpoint, "--out", str(out)])
    assert done.exit_code == 0, done.output
    assert (out / "report.html").read_text(encoding="utf-8").startswith("<!DOCTYPE html>")
    msgspec.json.decode((out / "report.json").read_bytes(), type=Report)
    key = f"jobs/{jobs[0]}/rollouts/3/export?format=scenario"
    asked = ["get", key, "--connect", endpoint, "--timeout", "60"]
    assert CliRunner().invoke(main, [*asked, "--out", str(tmp_path / "r.toml")]).exit_code == 0
    assert "[fixed]" in (tmp_path / "r.toml").read_text(encoding="utf-8")
    refused = CliRunner().invoke(main, asked)
    assert refused.exit_code == 2
    assert "--out FILE" in refused.output


@pytest.mark.parametrize(
    ("ask", "kind", "says"),
    [
        (lambda c, j: c.comparison([j]), "bad-parameter", "2 to 6"),
        (lambda c, j: c.comparison([j, j]), "bad-parameter", "different jobs"),
        (lambda c, j: c.comparison([j, "nope"]), "no-such-job", "nope"),
        (lambda c, j: c.risk(j, baseline="often"), "bad-job", "events per million km"),
        (lambda c, j: c.risk("nope"), "no-such-job", "nope"),
        (lambda c, j: c.learned(j, rollouts=-1), "bad-parameter", "rollouts"),
        (lambda c, j: c.export(j, 3, "avi"), "bad-parameter", "avi"),
        (lambda c, j: c.export(j, 9999, "fcd"), "not-found", "no rollout 9999"),
        (lambda c, j: c.rollout(j, 3, camera=500), "bad-parameter", "at most 100"),
        (lambda c, j: c.report("nope"), "no-such-job", "nope"),
    ],
)
def test_wrong_questions(client: Client, jobs: list[str], ask, kind: str, says: str) -> None:
    with pytest.raises(Refused, match=says) as caught:
        ask(client, jobs[0])
    assert caught.value.kind == kind
