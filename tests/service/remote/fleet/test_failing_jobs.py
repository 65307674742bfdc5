"""Failures do not look like success: a job of which too many rollouts fail has failed, says why, withholds its p."""

from __future__ import annotations

import numpy as np
import pytest

from service.errors import InputError, TooManyFailures
from service.evaluation.failed_share import too_many
from service.evaluation.job import make_job
from service.evaluation.recorded import Watcher, evaluate_recorded
from service.evaluation.store import FAILED, Chunk, Origin, RunDirectory
from service.evaluation.store.jobs import JobStore
from service.remote.client import Client
from service.remote.fleet.answers import answer_of
from service.remote.fleet.policy import Policy
from tests.service.remote.fleet import broken_ego
from tests.service.remote.fleet.light import LightRunner, LightWorker, free_port, light_answer, light_fleet
from tests.service.remote.fleet.processes import LIMIT_S, Process, serve, wait, worker

POLICY = Policy(chunk_s=0.5, first_rows=20, max_rows=20, hold_s=0.3, audit_share=0.0)


class Failing(LightRunner):
    """Every rollout fails, or those of every fifth chunk."""

    every = 1

    def run(self, lease):
        key = lease.chunk
        if (key.start // 20 + 1) % self.every:
            return light_answer(self.worker, lease)
        n = key.stop - key.start
        errors = {i: f"EgoError: no action in row {key.start + i}" for i in range(n)}
        chunk = Chunk(key.start, key.stop, np.full(n, np.nan), np.full(n, FAILED, np.uint8),
                      np.zeros(n, np.int32), errors, 0.2)  # fmt: skip
        return answer_of(self.worker, lease.lease, key, chunk)


class SometimesFailing(Failing):
    every = 5


@pytest.fixture
def job(make_scenario):
    return make_job(make_scenario(), "idm", 2.0, "naive", 1, {"budget": 2000, "batch_size": 500})


def test_a_job_whose_every_rollout_fails_has_failed_before_its_budget_is_burnt(tmp_path, job):
    with light_fleet(tmp_path, POLICY) as fleet:
        name = fleet.fleet.submit(job).id
        runner = LightWorker(fleet.port, "w", Failing)
        fleet.wait_status(name, "failed")
        runner.stop()
        view, told = fleet.fleet.job(name), fleet.fleet.estimate(name)
        assert "20 of 20 rollouts failed, more than the share 0.1 that is tolerated" in view.reason
        assert "rollout 0 (estimate 0): EgoError: no action in row 0; rollout 1 (estimate 0)" in view.reason
        assert (told["p"], told["std_error"], told["ci"]) == (None, None, [0.0, 1.0])
        assert sum(c.stop - c.start for *_, c in fleet.store.chunks.all_chunks(name)) < 100
        with pytest.raises(InputError, match="its p is withheld: 20 of 20 rollouts failed"):
            fleet.fleet.curve(name, [1.0])


def test_all_may_fail_where_that_is_tolerated_and_still_it_is_no_success(tmp_path, job):
    with light_fleet(tmp_path, POLICY) as fleet:
        name = fleet.fleet.submit(job, max_failed=1.0).id
        runner = LightWorker(fleet.port, "w", Failing)
        fleet.wait_status(name, "failed")
        runner.stop()
        assert "2,000 of 2,000 rollouts failed, all that there were" in fleet.fleet.job(name).reason


@pytest.mark.parametrize(("max_failed", "status"), [(0.15, "failed"), (0.3, "done")])
def test_a_share_is_tolerated_as_it_was_asked_for_also_after_a_restart(tmp_path, job, max_failed, status):
    with light_fleet(tmp_path, POLICY) as fleet:
        name = fleet.fleet.submit(job, max_failed=max_failed).id
    with light_fleet(tmp_path, POLICY) as fleet:
        runner = LightWorker(fleet.port, "w", SometimesFailing)
        fleet.wait_status(name, status)
        runner.stop()
        assert (fleet.fleet.estimate(name)["p"] is None) == (status == "failed")
    with light_fleet(tmp_path, POLICY) as fleet:
        assert fleet.fleet.job(name).status == status


def test_failed_rollouts_of_the_record_count_when_a_job_is_opened_again(tmp_path, job):
    with JobStore(f"sqlite:///{tmp_path / 'fleet.sqlite'}") as store:
        store.add_job("j", job, 0, 1.0, "", "running", 0.1)
        failed = Chunk(0, 60, np.full(60, np.nan), np.full(60, FAILED, np.uint8), np.zeros(60, np.int32),
                       dict.fromkeys(range(60), "lost"), 1.0)  # fmt: skip
        store.append([("j", "estimate", 0, failed, Origin("w", 0))])
    with light_fleet(tmp_path, POLICY) as fleet:
        fleet.wait_status("j", "failed")
        assert "60 of 60 rollouts failed" in fleet.fleet.job("j").reason


@pytest.mark.parametrize(
    ("failed", "rollouts", "share", "at_end", "ends"),
    [
        (0, 0, 0.0, True, False),
        (1, 10, 0.0, False, True),
        (5, 10, 0.1, True, False),
        (6, 10, 0.1, True, True),
        (10, 10, 1.0, True, True),
        (10, 10, 1.0, False, False),
        (100, 1000, 0.1, False, False),
        (101, 1000, 0.1, False, True),
    ],
)
def test_when_a_job_has_failed(failed, rollouts, share, at_end, ends):
    assert bool(too_many(failed, rollouts, share, ["rollout 0: lost"], at_end)) == ends


def test_a_run_here_whose_every_rollout_fails_has_failed_whatever_is_tolerated(
    tmp_path, make_scenario, monkeypatch
):
    monkeypatch.setenv("TAILROAD_PYTHON_EGOS", broken_ego.EGO)
    job = make_job(make_scenario(), broken_ego.EGO, 2.0, "naive", 1, {"budget": 20, "batch_size": 10})
    with (
        RunDirectory.create(tmp_path / "run", (job,)) as run,
        pytest.raises(TooManyFailures, match="20 of 20 rollouts failed, all that there were: rollout 0"),
    ):
        evaluate_recorded(run, job, 1, Watcher(), 1.0)


def test_submit_of_an_ego_that_never_drives_ends_failed_with_its_first_messages(tmp_path, monkeypatch):
    """Real processes: serve, worker, submit and watch."""
    monkeypatch.setenv("TAILROAD_PYTHON_EGOS", broken_ego.EGO)
    port = free_port()
    where = ("--connect", f"tcp/127.0.0.1:{port}")
    service = serve(tmp_path / "fleet", port)
    service.wait_line("serving on")
    helper = worker(port)
    helper.wait_line("is connected")
    asked = Process("submit", "i80-paper-10s", "--ego", broken_ego.EGO, "--gamma", "0.7", "--method", "naive",
                    "--budget", "2000", "--max-failed", "0.2", *where)  # fmt: skip
    assert asked.process.wait(LIMIT_S) == 0, asked.lines
    with Client(f"tcp/127.0.0.1:{port}") as client:
        (job,) = client.all_jobs()
        assert job.max_failed == 0.2
        wait(lambda: client.job(job.id).status != "running", (service, helper))
        over, told = client.job(job.id), client.estimate(job.id)
        assert over.status == "failed"
        assert "the ego has no engine" in over.reason
        assert (told.p, told.ci) == (None, (0.0, 1.0))
        assert told.rollouts.total < 2000
    watched = Process("watch", job.id, *where)
    assert watched.process.wait(LIMIT_S) == 1
    helper.stop()
    service.stop()
