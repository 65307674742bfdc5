"""What the commands print in 80 columns: intervals and job ids are never cut, and what is withheld is not printed."""

from __future__ import annotations

import os
import signal
import subprocess
import sys

import pytest

from service.analysis.exposure import Exposure
from service.analysis.risk import rate_of
from service.evaluation.summary import withheld_for
from service.front.cli import batch, jobs
from service.front.matrix.verdict import Result
from service.remote.api.objects import Job

WIDE = "0.000123 to 0.000987"


@pytest.fixture(autouse=True)
def eighty_columns(monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")


def test_a_batch_keeps_its_intervals_whole(capsys):
    one = Result(scenario="i80-10s", ego="sumo:Krauss", gamma=0.46, method="splitting", at="here", status="done",
                 p=4.56e-4, low=1.23e-4, high=9.87e-4, rollouts=200_000, events=12_345,
                 verdict="not-below")  # fmt: skip
    batch._print([one], None)
    told = capsys.readouterr().out
    assert WIDE in told
    for word in ("i80-10s", "sumo:Krauss", "splitting", "200,000", "12,345", "not-below"):
        assert word in told
    assert max(map(len, told.splitlines())) <= 80


def test_a_list_of_jobs_keeps_its_ids_whole(capsys):
    name = "i80-10s-0123456789abcdef-0123"
    job = Job(id=name, number=1, label="nightly run", scenario="i80-10s", ego="sumo:Krauss", gamma=0.46,
              method="splitting", options={"budget": 200_000}, seed=1, priority=0, weight=1.0, at="", status="running",
              reason="", rollouts=123_456, leases=0, refusals={}, unit="s")  # fmt: skip

    class Listing:
        def all_jobs(self):
            return [job]

    jobs.command.callback.__wrapped__(None, None, 100, client=Listing(), as_json=False)
    told = capsys.readouterr().out
    assert name in told
    assert "123,456" in told
    assert max(map(len, told.splitlines())) <= 80


def test_no_rate_is_made_of_an_estimate_that_is_withheld():
    exposure = Exposure(rollouts=40, km=0.2, km_ci=(0.19, 0.21), hours=0.01, confidence=0.95)
    withheld = withheld_for(("few-events", "dominant-weight"), 6000)
    assert withheld == ("dominant-weight",)
    risk = rate_of(9e-93, (0.0, 1e-90), 0.95, exposure, "a contact", withheld=withheld)
    assert risk.summary == (
        "A contact: no rate per million km, because the estimate cannot be relied on (dominant-weight); see its "
        "warnings and their remedies."
    )
    assert risk.per_million_km is None
    assert risk.km_between is None
    assert withheld_for(("no-events",), 0) == ()  # naive Monte Carlo: its interval holds
    assert withheld_for(("no-events",), 100) == ("no-events",)


@pytest.mark.parametrize(
    "command", [("rollout", "i80", "--video", "film.mp4"), ("bench", "--rollouts", "100000")]
)
def test_ctrl_c_ends_with_130(tmp_path, command):
    """Each tells by its first line of Python's own import log that it is at work."""
    code = "import sys; from service.front.cli import main; main()"
    environment = os.environ | {"PYTHONPATH": os.getcwd(), "PYTHONVERBOSE": "1"}
    with subprocess.Popen([sys.executable, "-c", code, *command], cwd=tmp_path, env=environment, text=True,
                          stdout=subprocess.DEVNULL, stderr=subprocess.PIPE) as process:  # fmt: skip
        assert process.stderr is not None
        for line in process.stderr:
            if line.startswith("import 'libsumo"):
                process.send_signal(signal.SIGINT)
                break
        rest = process.stderr.read()
        assert process.wait(timeout=120) == 130
    assert "Interrupted." in rest
    assert "Traceback" not in rest
