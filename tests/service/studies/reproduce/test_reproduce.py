"""Plans carried out on this machine: interrupted, gone on with, and told on a page that has every number."""

from __future__ import annotations

import json

import msgspec
import numpy as np
import pytest
from click.testing import CliRunner

from service.errors import InputError, StoreError
from service.evaluation import recorded
from service.evaluation.job import Problem, compiled, in_sumo, make_job
from service.evaluation.pool import run_chunk
from service.evaluation.store import RunDirectory
from service.front.cli.main import main
from service.studies.reproduce import qualitative
from service.studies.reproduce.black_box import black_box
from service.studies.reproduce.local import Watch, accumulate, carry_out, run_as_job, truth_path
from service.studies.reproduce.page import page_of, write_page
from service.studies.reproduce.plans import PLANS, Plan, Run, Truth, plans_of
from service.studies.reproduce.scale import play
from service.studies.reproduce.sizes import SCALES
from service.world.scenario import load_scenario
from service.world.sim.without_sumo import WithoutSumo


@pytest.fixture(scope="module")
def scenario_file(scenario_text, tmp_path_factory) -> str:
    path = tmp_path_factory.mktemp("scenario") / "second.toml"
    path.write_text(scenario_text.replace("horizon_s = 10.0", "horizon_s = 1.0"), encoding="utf-8")
    return str(path)


@pytest.fixture
def plan(scenario_file) -> Plan:
    run = Run(series="splitting", scenario=scenario_file, ego="idm", gamma=0.95, method="splitting",
              options={"budget": 1000}, seed=1, noise_mode="searched")  # fmt: skip
    naive = msgspec.structs.replace(
        run, series="naive", method="naive", options={"budget": 40}, noise_mode=None
    )
    return Plan(name="tried", scale="smoke", title="A try", truth=Truth(scenario=scenario_file, ego="idm", rollouts=60),
                gammas=(0.98, 0.95), runs=(run, naive))  # fmt: skip


class Here:
    """A pool whose only worker is this process."""

    def __init__(self, job, workers, open_world):
        problem = Problem(job)
        alone = open_world is compiled
        self._world = (
            WithoutSumo(job.scenario, problem.corridor, problem.drivers, job.ego)
            if alone
            else open_world(job)
        )

    def warm_up(self) -> None:
        pass

    def run(self, works):
        for work in works:
            yield run_chunk(self._world, work)

    def __exit__(self, *_: object) -> None:
        self._world.close()


@pytest.fixture(autouse=True)
def no_processes(monkeypatch):
    monkeypatch.setattr(recorded, "LocalPool", Here)


class Interrupted(Exception):
    pass


def test_a_plan_goes_on_where_it_was_interrupted_and_comes_to_the_same(plan, tmp_path):
    def carried(out, watch=None):
        return carry_out(plan, out, out / "truths", 1, False, watch or Watch())

    told = []

    def stop(count: int) -> None:
        told.append(count)
        if sum(told) > 300:
            raise Interrupted

    with pytest.raises(Interrupted):
        carried(tmp_path / "a", Watch(on_rollouts=stop))
    counts = []
    first = carried(tmp_path / "a", Watch(on_rollouts=counts.append))
    assert sum(counts) == plan.rollouts
    whole = carried(tmp_path / "b")

    def kept(outcome):
        return [msgspec.structs.replace(r, worker_s=0.0, sim_s=0.0, wall_s=0.0) for r in outcome.results]

    assert kept(first) == kept(whole)
    assert first.truth.at(plan.gammas)["events"].tolist() == whole.truth.at(plan.gammas)["events"].tolist()
    assert first.truth.rollouts == 60
    splitting, naive = first.results
    assert splitting.readings[1].p is not None
    assert naive.rollouts == 40
    more = accumulate(
        msgspec.structs.replace(plan.truth, rollouts=80),
        truth_path(plan.truth, tmp_path / "a" / "truths"), 1, compiled, Watch(),
    )  # fmt: skip
    assert more.rollouts == 80
    assert more.at(plan.gammas, 60)["events"].tolist() == first.truth.at(plan.gammas)["events"].tolist()

    path = write_page(page_of(first, "tailroad reproduce tried"), tmp_path / "pages")
    text = path.read_text(encoding="utf-8")
    assert "one in 100 of them in SUMO too" in text
    assert "60 rollouts" in text
    assert all(f"γ = {g:g} s" in text for g in plan.gammas)
    stored = json.loads((tmp_path / "pages" / "tried-smoke" / "results.json").read_text(encoding="utf-8"))
    assert [r["rollouts"] for r in stored["results"]] == [r.rollouts for r in first.results]
    pictures = sorted(p.name for p in (tmp_path / "pages" / "tried-smoke").glob("*.svg"))
    assert pictures == ["efficiency.svg", "events.svg", "p.svg", "variances.svg"]
    assert all(f"tried-smoke/{name}" in text for name in pictures)


def test_a_run_directory_of_another_job_is_refused(plan, tmp_path):
    run = plan.runs[1]
    other = run_as_job(msgspec.structs.replace(run, seed=9))
    with RunDirectory.create(tmp_path / run.folder, (other,)) as store:
        assert store.jobs == (other,)
    with pytest.raises(StoreError, match="with seed = 9 and not 1"):
        carry_out(
            msgspec.structs.replace(plan, runs=(run,)), tmp_path, tmp_path / "truths", 1, False, Watch()
        )


@pytest.mark.parametrize("name", PLANS)
def test_every_plan_has_jobs_that_can_be_made_at_every_scale(name):
    for scale in SCALES:
        for plan in plans_of(name, scale):
            for run in {
                (r.method, r.noise_mode, str(r.options)): r for r in plan.runs if r.ego != "vision"
            }.values():
                assert run_as_job(run).options["budget"] == run.budget
            folders = [run.folder for run in plan.runs]
            assert len(set(folders)) == len(folders)
    with pytest.raises(InputError, match="no scale named"):
        plans_of(name, "huge")


def test_more_workers_end_sooner_and_none_is_more_than_wholly_busy():
    job = make_job(
        load_scenario("i80-paper-10s"), "lidar", 0.5, "naive", 1, {"budget": 1200, "batch_size": 1200}
    )
    alone, together = (play(job, np.array([0.02, 0.04]), workers) for workers in (1, 12))
    assert alone.rollouts == 1200
    assert alone.rollout_ms == pytest.approx(30.0)
    assert 0.7 < alone.efficiency <= 1.0
    assert 0.4 < together.efficiency <= 1.0
    assert together.makespan_s < alone.makespan_s / 5
    assert together.rollouts_per_s == pytest.approx(together.rollouts / together.makespan_s)


def test_the_black_box_answers_a_plan_s_rollouts(scenario_file, tmp_path):
    """Served in a process of its own, it drives like the `idm` ego that it hides."""
    with black_box("hidden"):
        truth = Truth(scenario=scenario_file, ego="zenoh:hidden", rollouts=4)
        hidden = accumulate(truth, tmp_path / "hidden.npz", 1, in_sumo, Watch())
    known = accumulate(msgspec.structs.replace(truth, ego="idm"), tmp_path / "idm.npz", 1, compiled, Watch())
    assert hidden.rollouts == known.rollouts == 4
    assert hidden.ran.outcomes == known.ran.outcomes
    assert hidden.lowest(4).tolist() == known.lowest(4).tolist()


def test_the_qualitative_page_tells_what_was_learned_and_how_it_fails(scenario_file, tmp_path, monkeypatch):
    monkeypatch.setattr(qualitative, "SCENARIO", scenario_file)
    monkeypatch.setattr(qualitative, "EGO", "idm")
    monkeypatch.setattr(qualitative, "SIZES", {"smoke": qualitative.Size((1.2,), 1000, 2, 0)})
    page = qualitative.qualitative_page(
        "smoke", 1, tmp_path, tmp_path / "pages", 1, False, Watch(), "tailroad reproduce qualitative"
    )
    assert [t.title.rpartition(": ")[2] for t in page.tables] == [
        "starts", "how the drivers drive", "how it fails",
    ] * 2  # fmt: skip
    starts = {row[0] for row in page.tables[3].rows}
    assert {"ego.speed_mps", "env6.heading_deg"} <= starts
    path = write_page(page, tmp_path / "pages")
    assert "2 and 2 rollouts, run again in SUMO" in path.read_text(encoding="utf-8")


def test_wrong_use_of_the_command_ends_with_2_and_one_sentence():
    for words, told in (
        (["table9"], "is not one of"),
        (["scale", "--connect", "tcp/127.0.0.1:1"], "--connect does not go with scale"),
        (["worlds", "--connect", "tcp/127.0.0.1:1"], "--connect does not go with worlds"),
    ):
        result = CliRunner().invoke(main, ["reproduce", *words])
        assert result.exit_code == 2
        assert told in result.output
