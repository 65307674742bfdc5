"""Runs as Python objects: asked, interrupted, gone on with, and looked at, with egos of every kind."""

from __future__ import annotations

import contextlib
import json
import os
import subprocess
import sys
from pathlib import Path

import cv2
import polars as pl
import pytest

import tailroad
from policies.egos import Observation
from service.analysis.run.question import jobs_of
from service.errors import InputError, StoreError
from service.evaluation.store import RunDirectory

GAMMA = 2.0  # s; dangerous enough that a few rollouts show it


@pytest.fixture(scope="module")
def scenario(make_scenario):
    return make_scenario({"horizon_s = 10.0": "horizon_s = 2.0"})


class Steady:
    """Keeps its speed; `gain` is what an instance brings with it."""

    def __init__(self, gain: float = 0.0):
        self.gain = gain

    def reset(self, seed: int) -> None:
        pass

    def act(self, observation: Observation) -> tuple[float, float]:
        return self.gain, 0.0


def estimate(scenario, folder: Path, ego="idm", **others):
    asked = {"gamma": GAMMA, "method": "naive", "budget": 60, "workers": 1} | others
    return tailroad.estimate(scenario, ego, out=folder, **asked)


@pytest.fixture(scope="module")
def run(scenario, tmp_path_factory):
    return estimate(scenario, tmp_path_factory.mktemp("run") / "run")


def test_a_run_has_its_estimate_its_table_and_its_directory(run):
    e = run.estimate
    assert e.rollouts.total == 60
    assert e.p == e.events / 60
    assert e.ci[0] < e.p < e.ci[1]
    table = run.to_polars()
    assert table.height == 60
    assert (table["f"] <= GAMMA).sum() == e.events
    assert (run.path / "run.json").exists()


def test_a_run_and_its_estimate_show_themselves_in_a_notebook(run):
    for html in (run._repr_html_(), run.estimate._repr_html_()):
        assert f"{run.estimate.ci[0]:.3f}"[:4] in html
        assert "95% interval" in html
        assert "<script" not in html
    assert "p = " in repr(run)


def test_a_dangerous_rollout_is_replayed_in_every_form(run, tmp_path):
    worst = run.replay(1, by="f")
    assert worst.f == run.to_polars()["f"].min()
    film = cv2.VideoCapture(str(worst.video(tmp_path / "worst.mp4")))
    assert film.get(cv2.CAP_PROP_FRAME_COUNT) > 1
    assert pl.read_parquet(worst.trace(tmp_path / "worst.parquet"))["ttc_s"].min() == worst.f
    assert worst.fcd(tmp_path / "worst.xml").stat().st_size > 100
    with pytest.raises(InputError, match=r"\.mp4"):
        worst.video(tmp_path / "worst.avi")
    with pytest.raises(InputError, match="counted from 1"):
        run.replay(10_000)


def test_the_same_question_in_the_same_folder_runs_nothing_twice(scenario, run):
    told = []
    again = estimate(scenario, run.path, progress=told.append)
    assert again.estimate.p == run.estimate.p
    assert told[-1].rollouts == 60
    with pytest.raises(StoreError, match="another question"):
        estimate(scenario, run.path, seed=2)
    with pytest.raises(StoreError, match="already"):
        estimate(scenario, run.path, new=True)


def test_an_interrupted_run_is_gone_on_with_to_the_same_bits(scenario, run, tmp_path):
    def stop(progress):
        if progress.rollouts >= 30:
            raise KeyboardInterrupt

    asked = {"options": {"batch_size": 30}}
    whole = estimate(scenario, tmp_path / "whole", **asked)
    with pytest.raises(tailroad.Interrupted) as stopped:
        estimate(scenario, tmp_path / "cut", progress=stop, **asked)
    assert stopped.value.path == tmp_path / "cut"
    with RunDirectory.open(tmp_path / "cut") as store:
        assert 0 < sum(chunk.stop - chunk.start for _, _, chunk in store.all_chunks("naive")) < 60
    on = tailroad.resume(stopped.value.path, workers=1)
    assert on.to_polars().sort("row").equals(whole.to_polars().sort("row"))


def test_two_jobs_of_one_method_live_in_one_run(scenario, tmp_path):
    run = estimate(scenario, tmp_path / "run", gamma=(GAMMA, 1.0), seed=(1, 2), budget=20)
    assert list(run.estimates) == ["naive", "naive-2", "naive-3", "naive-4"]
    assert [(e.gamma, e.seed) for e in run.estimates.values()] == [(2.0, 1), (2.0, 2), (1.0, 1), (1.0, 2)]
    by_job = {key[0]: table for key, table in run.to_polars().group_by("job")}
    for name, one in run.estimates.items():
        assert (by_job[name]["f"] <= one.gamma).sum() == one.events
    page = run.report().read_text(encoding="utf-8")
    for gamma, seed in ((2, 1), (2, 2), (1, 1), (1, 2)):
        assert f"naive Monte Carlo (f ≤ {gamma} s, seed {seed})" in page.lower().replace(
            "monte carlo", "Monte Carlo"
        )
    facts = json.loads((tmp_path / "run" / "report.json").read_text())
    assert facts["disagreement"] is None  # p differs with the threshold, which is none
    assert {j["gamma"] for j in facts["jobs"] if j["id"] == facts["headline"]["job"]} == {2.0}
    alone = estimate(scenario, tmp_path / "alone", seed=2, budget=20)
    assert run.estimates["naive-2"].p == alone.estimate.p
    again = tailroad.resume(tmp_path / "run")
    assert {k: e.p for k, e in again.estimates.items()} == {k: e.p for k, e in run.estimates.items()}


def test_a_job_of_an_older_run_directory_is_still_found_by_its_method(scenario, run, tmp_path):
    text = (run.path / "run.json").read_text()
    assert '"name": ""' in text
    (tmp_path / "run.json").write_text(text.replace(',\n      "name": ""', ""))
    (tmp_path / "rollouts.sqlite").write_bytes((run.path / "rollouts.sqlite").read_bytes())
    assert '"name": ""' not in (tmp_path / "run.json").read_text()
    assert tailroad.resume(tmp_path).estimate.p == run.estimate.p


def test_egos_are_given_as_name_class_function_or_instance(scenario, tmp_path):
    class Local(Steady):
        pass

    found = {}
    ways = {"class": Local, "function": lambda: Steady(), "instance": Steady(), "other": Steady(2.0)}
    for name, ego in ways.items():
        found[name] = estimate(scenario, tmp_path / name, ego)
    assert found["class"].estimate.ego == "here:Local"
    f = {name: run.to_polars()["f"].to_list() for name, run in found.items()}
    assert f["class"] == f["function"] == f["instance"] != f["other"]
    assert len(found["class"].failures(limit=1).failures) == 1
    with pytest.raises(InputError, match="reset and act"):
        estimate(scenario, tmp_path / "none", 3)


def test_an_ego_of_this_process_is_asked_for_again_and_must_be_the_same(scenario, tmp_path):
    class Local(Steady):
        pass

    class Other(Steady):
        pass

    run = estimate(scenario, tmp_path / "run", Local)
    with pytest.raises(InputError, match="here:Local"):
        tailroad.resume(run.path, Other)
    assert tailroad.resume(run.path, Local).estimate.p == run.estimate.p
    code = f"import tailroad; tailroad.resume({str(run.path)!r})"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert "give it again in Python, as in tailroad.resume(RUN, ego=MyEgo)" in done.stderr


def test_a_script_needs_no_guard_around_its_main_part(tmp_path):
    script = tmp_path / "mine.py"
    script.write_text(
        "import tailroad\n"
        "run = tailroad.estimate('i80-10s', 'idm', gamma=2.0, method='naive', budget=10, workers=1, out='r')\n"
        "print('rollouts', run.estimate.rollouts.total)\n"
    )
    done = subprocess.run([sys.executable, str(script)], cwd=tmp_path, capture_output=True, text=True)
    assert done.stdout == "rollouts 10\n", done.stderr
    assert done.stderr == ""


def on_a_terminal(code: str) -> str:
    """What Python code writes to standard error where that is a terminal."""
    terminal, seen_as = os.openpty()
    with os.fdopen(terminal, "rb", buffering=0) as screen:
        shown = subprocess.Popen([sys.executable, "-c", code], stderr=seen_as, stdout=subprocess.DEVNULL)
        os.close(seen_as)
        written = b""
        with contextlib.suppress(OSError):  # how a terminal says that nobody writes to it any more
            while part := screen.read(4096):
                written += part
    assert shown.wait() == 0, written
    return written.decode()


def test_a_terminal_sees_how_far_a_run_is_unless_it_is_told_not_to(run):
    again = f"import tailroad; tailroad.resume({str(run.path)!r}, workers=1, progress={{}})"
    assert "60/60" in on_a_terminal(again.format(True))
    assert on_a_terminal(again.format(False)) == ""


@pytest.mark.parametrize(
    ("asked", "told"),
    [
        (
            {"method": "naive", "options": {"rho": 0.1}},
            "method naive has no option 'rho'; it is one of ce, mixture",
        ),
        ({"method": "ce", "options": {"rhoo": 0.1}}, "did you mean 'rho'"),
        ({"method": "ce", "options": {"rho": "much"}}, "option 'rho' of method ce"),
        ({"method": "cee"}, "no method named 'cee'"),
        ({"options": {"budget": 3}}, "place of its own"),
        ({"method": ()}, "nothing to run"),
    ],
)
def test_what_does_not_apply_is_refused_by_name(scenario, asked, told):
    with pytest.raises(InputError, match=told):
        jobs_of(scenario, "idm", GAMMA, **asked)


def test_the_method_is_auto_unless_another_is_asked_for(scenario):
    (job,) = jobs_of(scenario, "idm", GAMMA)
    assert job.method == "auto"


def test_an_option_goes_to_every_method_that_has_it(scenario):
    jobs = jobs_of(scenario, "idm", GAMMA, ("naive", "ce"), options={"rho": 0.1})
    assert [job.options.get("rho") for job in jobs] == [None, 0.1]
