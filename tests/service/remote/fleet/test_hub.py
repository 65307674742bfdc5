"""The hub with its threads: what it keeps of jobs that are over."""

from __future__ import annotations

import sqlite3
import threading
import time

import numpy as np
import pytest

from service.errors import StoreError
from service.evaluation.job import make_job
from service.evaluation.store.jobs import JobStore
from service.evaluation.store.states import KeptState, LastState
from service.remote.fleet.batch_step import open_step
from service.remote.fleet.hub import Hub
from service.remote.fleet.jobs import Phase
from service.remote.fleet.statistics import KEPT
from tests.service.remote.fleet.light import LIMIT_S, LightFleet, LightWorker, light_fleet


def test_jobs_cancelled_while_they_are_opened_leave_nothing_behind(tmp_path, make_scenario):
    job = make_job(make_scenario(), "idm", 0.5, "naive", 1, {"budget": 10, "batch_size": 10})
    with light_fleet(tmp_path) as fleet:
        for _ in range(KEPT + 4):
            fleet.fleet.cancel(fleet.fleet.submit(job).id)
        last = fleet.fleet.submit(job).id
        deadline = time.monotonic() + LIMIT_S
        while fleet.hub.call(lambda scheduler: scheduler.jobs[last].phase).result() is not Phase.WORKING:
            assert time.monotonic() < deadline
        statistics = fleet.hub.statistics
        while len(statistics._open) > 1:  # one of those before may still be opened
            assert time.monotonic() < deadline, "more jobs are kept than those that are wanted"
        assert len(statistics._problems) <= KEPT + 2
        assert statistics._open[last][1].batch is not None
        fleet.fleet.cancel(last)
        fleet.wait_status(last, "cancelled")
        while last in statistics._open:  # its batch is as large as all the rest together
            assert time.monotonic() < deadline, "the batch of a job that is over is kept"
        assert fleet.fleet.estimate(last)["rollouts"]["total"] == 0
        assert statistics._read[last].step.batch is None


def kept_state(fleet: LightFleet, job: str) -> KeptState | None:
    return fleet.store.states.kept(job, fleet.store.epoch(job))


def wait_kept(fleet: LightFleet, job: str) -> None:
    deadline = time.monotonic() + LIMIT_S
    while kept_state(fleet, job) is None:
        assert time.monotonic() < deadline, "what the job came to is not kept"
        time.sleep(0.01)


@pytest.mark.parametrize("method", ["naive", "ce"])
def test_what_a_done_job_came_to_outlives_the_service_without_a_replay(
    tmp_path, make_scenario, monkeypatch, method
):
    options = {"budget": 1000}
    if method == "ce":
        options |= {"iterations": 2, "samples_per_iteration": 100}
    job = make_job(make_scenario(), "idm", 2.0, method, 1, options)
    with light_fleet(tmp_path) as fleet:
        worker = LightWorker(fleet.port, "w")
        name = fleet.fleet.submit(job).id
        fleet.wait_status(name, "done")
        worker.stop()
        told = fleet.fleet.estimate(name)
        wait_kept(fleet, name)
    replayed = []
    monkeypatch.setattr(
        "service.remote.fleet.statistics.open_step", lambda *of: replayed.append(of) or open_step(*of)
    )
    with light_fleet(tmp_path) as fleet:
        assert not fleet.fleet.at_hand(name)
        assert fleet.fleet.estimate(name) == told
        assert replayed == []
        curve = fleet.fleet.curve(name, [1.0, 2.0]).p
    with sqlite3.connect(tmp_path / "fleet.sqlite") as connection:
        connection.execute("UPDATE states SET state = x'c1'")
    with light_fleet(tmp_path) as fleet:  # what is kept and cannot be read is made again
        assert fleet.fleet.estimate(name) == told
        assert len(replayed) == 1
        np.testing.assert_array_equal(fleet.fleet.curve(name, [1.0, 2.0]).p, curve)
    with sqlite3.connect(tmp_path / "fleet.sqlite") as connection:
        connection.execute("UPDATE states SET tailroad = '0.0.1'")
    with light_fleet(tmp_path) as fleet:  # what another version has kept is not looked at, and stays
        assert fleet.fleet.estimate(name) == told
        assert len(replayed) == 2
        assert kept_state(fleet, name) is not None


def test_a_state_kept_before_rollouts_were_voided_is_not_used(tmp_path, make_scenario):
    job = make_job(make_scenario(), "idm", 2.0, "naive", 1, {"budget": 400})
    with light_fleet(tmp_path) as fleet:
        worker = LightWorker(fleet.port, "wrong")
        name = fleet.fleet.submit(job).id
        fleet.wait_status(name, "done")
        worker.stop()
        wait_kept(fleet, name)
        kept = kept_state(fleet, name)
        fleet.store.states.keep(LastState(name, 0, 1, kept.last.record, b""))  # the first stays
        assert kept_state(fleet, name) == kept
        assert kept.sound
        assert kept.last.record == fleet.store.chunks.digest(name)
        fleet.store.quarantine("wrong", "a test")
        assert fleet.store.epoch(name) == 1
        assert kept_state(fleet, name) is None


@pytest.mark.filterwarnings("ignore::pytest.PytestUnhandledThreadExceptionWarning")
def test_a_hub_that_ends_by_an_error_says_so_and_lets_nobody_wait(tmp_path):
    died = threading.Event()
    with JobStore(f"sqlite:///{tmp_path / 'fleet.sqlite'}") as store:
        hub = Hub(store, on_death=died.set)
        hub.start()
        hub.post(BaseException)  # what the scheduler cannot handle
        assert died.wait(LIMIT_S)
        with pytest.raises(StoreError, match="the scheduler has ended"):
            hub.call(lambda scheduler: scheduler.jobs).result(LIMIT_S)
        hub.stop()
