"""The hub with its threads: what it keeps of jobs that are over."""

from __future__ import annotations

import threading
import time

import pytest

from service.errors import StoreError
from service.fleet.hub import Hub
from service.fleet.jobs import Phase
from service.fleet.statistics import KEPT
from service.job import make_job
from service.store.jobs import JobStore
from tests.service.fleet.light import LIMIT_S, light_fleet


def test_jobs_cancelled_while_they_are_opened_leave_nothing_behind(tmp_path, make_scenario):
    job = make_job(make_scenario(), "idm", 0.5, "naive", 1, {"budget": 10, "batch_size": 10})
    with light_fleet(tmp_path) as fleet:
        for _ in range(KEPT + 4):
            fleet.fleet.cancel(fleet.fleet.submit(job).id)
        last = fleet.fleet.submit(job).id
        deadline = time.monotonic() + LIMIT_S
        while fleet.hub.call(lambda scheduler: scheduler.jobs[last].phase).result() is not Phase.WORKING:
            assert time.monotonic() < deadline
        while len(fleet.hub.statistics._turns) > KEPT + 1:  # one of those before may still be opened
            assert time.monotonic() < deadline, "more jobs are kept than those that are wanted"
        assert fleet.hub.statistics._turns[last].batch is not None
        fleet.fleet.cancel(last)
        fleet.wait_status(last, "cancelled")
        while fleet.hub.statistics._turns[last].batch is not None:  # as large as all the rest together
            assert time.monotonic() < deadline, "the batch of a job that is over is kept"
        assert fleet.fleet.estimate(last)["rollouts"]["total"] == 0


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
