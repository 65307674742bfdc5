"""What the commands print in 80 columns: intervals and job ids are never cut, and what is withheld is not printed."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from service.analysis.comparison import objects as C
from service.analysis.exposure import Exposure
from service.analysis.failures.objects import Failure, Failures, Mode
from service.analysis.risk import rate_of
from service.evaluation.summary import withheld_for
from service.front.cli import batch, compare, estimate, failures, jobs
from service.front.matrix.verdict import Result
from service.remote.api.objects import Job
from tests.service.analysis.failures.test_modes import motion

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


def estimated(job: str, gamma: float = 0.5, seed: int = 1) -> dict:
    """What a job came to, in numbers as wide as they get."""
    span = [1.23e-5, 9.87e-5]
    chance = {"p": 4.56e-5, "ci": span, "rollouts": 12_345}
    sides = {"ego_side": "left", "other_side": "right", "name": "the ego's left side, the other's right side"}
    ending = {"outcome": "collision", "contacts": [sides | chance]} | chance
    return {"job": job, "method": job.split("-")[0], "gamma": gamma, "unit": "s", "measure": "ttc", "seed": seed,
            "scenario": "i80-paper-10s", "ego": "lidar-paper", "p": 4.56e-5, "std_error": 1.2e-6, "ci": span,
            "confidence": 0.95, "variance_reliable": False, "events": 12_345, "ess": 1234.5, "max_weight_share": 0.123,
            "rollouts": {"total": 200_000, "training": 123_456, "failed": 0}, "endings": [ending], "in_sumo": 2_000,
            "impacts": [{"mps": 2.0} | chance],
            "worker_s": 12_345.0, "x_realtime_per_core": 800.0, "warnings": []}  # fmt: skip


def test_estimates_keep_intervals_and_job_ids_whole_and_thresholds_have_their_own_headings(capsys):
    methods = ("naive", "ce", "mixture", "splitting", "auto")
    low = [estimated(job, 0.5) for job in methods]
    high = [estimated(f"{job}-2", 0.7, seed=2) for job in methods]
    against = {"ratio_of_rare_events": 123.4, "ratio_of_variances": None, "efficiency": None}
    compared = [{"method": s["job"], "variance_reliable": False} | against for s in (*low[1:], *high[1:])]
    estimate._print([*low, *high], compared)
    told = capsys.readouterr().out
    assert max(map(len, told.splitlines())) <= 80
    assert "…" not in told
    first, _, second = told.partition("p = P0(f <= 0.7 s)")
    assert "p = P0(f <= 0.5 s)" in first
    assert "seed 2" in second
    for s in low:
        assert s["job"] in first
        assert f"{s['job']}-2" in second
    for part in (first, second):
        assert part.count("1.23e-05 to 9.87e-05") == 5  # its interval
        assert (
            part.count("1.2e-05 to 9.9e-05") == 15
        )  # of its ending, the sides that met, and an impact speed
        assert "contact at 2 m/s or more" in " ".join(part.replace("│", " ").split())
        assert part.count("123.40") == 4


def test_failures_keep_the_names_of_their_modes_whole(capsys):
    mode = "ego-lane-change-front"
    failure = Failure(rank=1000, iteration=0, row=1_234_567, noise_seed="1", f=-12.34, f_again=-12.34,
                      same_to_the_bit=True, outcome="collision", error=None, log_likelihood=-1524.7,
                      starts_log_likelihood=0.0, weight=1.23e-5, share=0.987, mode=mode, kind=mode, other="env16",
                      motion=motion(time_s=12.3, other=16), starts={})  # fmt: skip
    way = Mode(mode=mode, name="ego changes lanes behind a slower vehicle", typical="so", events=12_345, share=0.987,
               share_ci=(0.97, 0.99), p=4.56e-4, ci=(1.23e-4, 9.87e-4), agreement=1.0, example=failure)  # fmt: skip
    found = Failures(job="splitting-2", run="run", scenario="i80-10s", ego="lidar", method="splitting", gamma=0.5,
                     unit="s", events=12_345, examined=400, confidence=0.95, p=4.56e-4, ci=(1.23e-4, 9.87e-4),
                     order="likelihood", modes=(way,), failures=(failure,), notes=())  # fmt: skip
    run = Path("runs/i80-paper-10s-lidar-paper-20261130-204822")
    failures._print(run, found)
    told = capsys.readouterr().out.splitlines()
    assert f"See one: tailroad replay {run} 1 --video rank1.mp4" in told
    assert max(len(line) for line in told if not line.startswith("See one")) <= 80
    whole = "\n".join(told)
    assert "…" not in whole
    assert whole.count(mode) == 3
    for word in (
        "1.2 × 10⁻⁴ to 9.9 × 10⁻⁴",
        "97% to 99%",
        "1234567",
        "env16",
        "12,345",
        "1.23e-05",
        "rank 1000",
    ):
        assert word in whole


def test_a_comparison_keeps_its_intervals_and_the_names_of_runs_whole(capsys):
    names = [f"i80-10s-lidar-20261130-20482{n}" for n in range(4)]
    ci = (1.2e-4, 9.8e-4)
    sides = tuple(
        C.Side(name=name, run=name, scenario="i80-paper-10s", ego="sumo:Krauss", method="splitting", seed=1,
             rollouts=200_000, events=12_345, ess=1234.5, p=4.56e-4, std_error=1e-5, ci=ci, warnings=())
        for name in names
    )  # fmt: skip
    difference = C.Difference(difference=-1.23e-4, difference_ci=(-9.8e-4, -1.2e-4), ratio=0.5, ratio_ci=(0.123, None),
                            paired=True, how="bounds", clear=True)  # fmt: skip
    side = C.ModeSide(events=12, p=4.56e-4, ci=ci)
    mode = "ego-lane-change-front"
    change = C.ModeChange(mode=mode, name="", a=side, b=side, difference=difference, change="unclear")
    pair = C.Pair(a=0, b=1, difference=difference, draws=None, modes=(change,), summary="so", said="so")
    line = C.Line(p=(), low=(), high=())
    compare._print(C.Comparison(gamma=0.5, unit="s", confidence=0.95, sides=sides, pairs=(pair,), notes=(),
                              curves=C.Curves(gamma=(), sides=(line,) * 4)))  # fmt: skip
    told = capsys.readouterr().out
    assert max(map(len, told.splitlines())) <= 80
    assert told.count("1.2 × 10⁻⁴ to 9.8 × 10⁻⁴") == 4
    assert told.count("-9.8 × 10⁻⁴ to -1.2 × 10⁻⁴") == 2
    assert mode in told
    assert f"{names[1]} against {names[0]}" in told
    assert "…" not in told
    for tail in ("204820", "204821", "204822", "204823"):
        assert tail in told


def test_a_rate_is_told_within_80_columns(capsys):
    exposure = Exposure(rollouts=40, km=0.2, km_ci=(0.19, 0.21), hours=0.01, confidence=0.95)
    estimate._print_rates({"naive": rate_of(0.0075, (0.0046, 0.0114), 0.95, exposure, "a contact")})
    told = capsys.readouterr().out
    assert told.startswith("As a rate, by naive: ")
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
