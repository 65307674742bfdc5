"""Runs of the method that drives paths: their bits, their failures, what they keep, and what they refuse."""

from __future__ import annotations

from pathlib import Path

import msgspec
import numpy as np
import pytest

import tailroad
from service.analysis.run.committors import committor_for, committor_from
from service.analysis.run.question import jobs_of
from service.errors import InputError, StoreError
from service.evaluation.path_store import batch_name, committor_in
from service.evaluation.store import RunDirectory
from service.evaluation.summary import comparison_of, simulated
from service.world.scenario import load_scenario

ASKED = {
    "gamma": 1.0,
    "method": "paths",
    "budget": 500,
    "options": {"batches": 5, "rounds": 1},
    "committor": "own",
    "seed": 4,
}


def asked(out: Path, **others) -> tailroad.Run:
    return tailroad.estimate("i80-paper-10s", "lidar-paper", out=out, **(ASKED | {"workers": 2} | others))


@pytest.fixture(scope="module")
def run(tmp_path_factory) -> tailroad.Run:
    return asked(tmp_path_factory.mktemp("paths") / "run")


def same(one: tailroad.Run, other: tailroad.Run) -> bool:
    a, b = one.results["paths"], other.results["paths"]
    return all(
        np.array_equal(getattr(a, name), getattr(b, name), equal_nan=True)
        for name in ("f", "log_weights", "root", "replication", "lineage", "seeds")
    ) and (a.p, a.ci, a.cost) == (b.p, b.ci, b.cost)


def test_the_estimate_is_near_what_counting_found_and_tells_how_rollouts_ended(run):
    """p(f <= 1 s) is 0.0715 by 10^6 naive rollouts (deploy/results/truth-paper.md has those below 1 s); one interval
    of so small a budget may miss it, as one in twenty does."""
    estimate = run.estimate
    assert estimate.ci[0] / 1.1 < 0.0715 < 1.1 * estimate.ci[1]
    assert estimate.rollouts.training > 0
    endings = {ending.outcome: ending for ending in estimate.endings}
    assert endings["horizon"].p == pytest.approx(1.0, abs=0.3)
    with RunDirectory.open(run.path) as store:
        chunks = list(store.all_chunks("paths"))
    assert sum(int(chunk.steps.sum()) for _, _, chunk in chunks) == run.results["paths"].cost.steps
    assert sum(chunk.driven_in_sumo for _, _, chunk in chunks) > 0


def test_a_run_cut_off_goes_on_with_another_number_of_workers_to_the_same_bits(run, tmp_path):
    def stop(progress):
        if getattr(progress.record, "phase", "") == "estimate" and progress.record.iteration == 1:
            raise KeyboardInterrupt

    with pytest.raises(tailroad.Interrupted):
        asked(tmp_path / "cut", progress=stop)
    with RunDirectory.open(tmp_path / "cut") as store:
        assert batch_name(1) in set(store.artefacts.names("paths"))
        assert batch_name(4) not in set(store.artefacts.names("paths"))
    assert same(run, tailroad.resume(tmp_path / "cut", workers=1))


def test_failures_come_back_in_sumo_to_the_bit_and_carry_the_estimate(run):
    failures = run.failures(limit=5, examine=30)
    assert failures.failures
    assert all(failure.same_to_the_bit for failure in failures.failures)
    assert sum(mode.share for mode in failures.modes) == pytest.approx(1.0)
    assert any("independent batches" in note for note in failures.notes)
    record = run.record(gamma=1.2)  # of another threshold, whose events are drawn again
    assert record.estimate.events > run.results["paths"].events
    assert record.estimate.p == pytest.approx(run.results["paths"].curve([1.2]).p[0])
    replayed = run.replay(1)
    assert replayed.f == pytest.approx(failures.failures[0].f)


def test_what_it_is_worth_counts_simulated_steps_and_not_paths_begun(run):
    estimate = run.results["paths"]
    spent, of_the_estimate = simulated(estimate)
    assert of_the_estimate < spent < estimate.rollouts
    found = comparison_of(estimate, estimate)
    assert found["efficiency"] == pytest.approx(estimate.efficiency)


def test_a_report_is_made_of_it(run, tmp_path):
    page = run.report(tmp_path / "report.html").read_text()
    assert "paths" in page


def test_a_committor_of_one_run_starts_another_without_training(run, tmp_path):
    with RunDirectory.open(run.path) as store:
        data = committor_in(store.artefacts, "paths")
    (tmp_path / "committor.bin").write_bytes(data)
    found, same_data = committor_from(run.path)
    assert same_data == data
    again = asked(tmp_path / "file", committor=tmp_path / "committor.bin", gamma=0.9, seed=5, workers=1)
    (job,) = again.jobs
    assert job.committor_sha256 == found.checksum
    assert again.results["paths"].cost.training_steps < run.results["paths"].cost.training_steps


def test_what_is_no_committor_is_refused(run, tmp_path):
    (tmp_path / "other").write_bytes(b"something else")
    with pytest.raises(StoreError, match="not a saved committor"):
        asked(tmp_path / "a", committor=tmp_path / "other")
    with pytest.raises(InputError, match="give a run directory"):
        asked(tmp_path / "b", committor=tmp_path / "missing")
    with pytest.raises(InputError, match="a committor is for the method paths"):
        asked(tmp_path / "c", committor=run.path, method="naive", options={})


@pytest.mark.parametrize(
    ("others", "match"),
    [
        ({"ego": "sumo:Krauss"}, "states that can be copied"),
        ({"measure": "rss"}, "states that can be copied"),
        ({"noise_mode": "frozen"}, 'noise_mode "frozen"'),
        ({"rel_error": 0.1}, "stops at no precision"),
        ({"options": {"rounds": "many"}}, "rounds"),
        ({"options": {"rho": 0.1}}, "rho"),
    ],
)
def test_what_cannot_be_driven_as_paths_is_refused_by_name(others, match, tmp_path):
    given = {"ego": "lidar-paper"} | ASKED | others
    with pytest.raises(InputError, match=match):
        tailroad.estimate(load_scenario("i80-paper-10s"), given.pop("ego"), out=tmp_path / "run", **given)


@pytest.mark.parametrize("name", ["i80-paper-10s", "i80-10s"])
def test_a_built_in_scenario_has_a_committor_of_its_own_whatever_it_is_called(name):
    scenario = load_scenario(name)
    found = committor_for(None, msgspec.structs.replace(scenario, name="mine", description=""))
    assert found is not None
    assert (
        committor_for(None, msgspec.structs.replace(scenario, start=load_scenario("us101-10s").start)) is None
    )
    assert committor_for("own", scenario) is None


def test_auto_drives_paths_where_it_can():
    def method(**others):
        given = {"scenario": "i80-paper-10s", "ego": "lidar-paper", "gamma": 0.5, "here": True, "meet": False}
        (job,) = jobs_of(**(given | others))
        return job.method, job.id

    assert method() == ("paths", "auto")
    assert method(here=False) == method(budget=1999) == method(rel_error=0.1) == ("auto", "auto")
    assert method(ego="vision-paper") == method(options={"batch_size": 500}) == ("auto", "auto")
