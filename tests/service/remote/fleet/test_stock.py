"""A service that begins: what other software began needs a restart, what the record lost is run again."""

from __future__ import annotations

import sqlite3

import msgspec
import pytest

from service.evaluation.job import make_job
from service.evaluation.software import Software, software
from service.evaluation.store import Origin
from service.evaluation.store.chunk import checksum_of
from service.evaluation.store.jobs import JobStore
from service.remote.fleet.first_look import first_look
from service.remote.fleet.policy import Policy
from service.remote.fleet.stock import take_stock
from tests.service.evaluation.store.test_beginnings import chunk
from tests.service.remote.fleet.light import LightWorker, free_port, light_fleet
from tests.service.remote.fleet.processes import JOB, recorded_bits, serve, submit, wait, wait_done, worker

POLICY = Policy(chunk_s=0.5, first_rows=20, max_rows=40, hold_s=0.3, audit_share=0.0)
EARLIER = Software(software().code, software().libraries | {"numpy": "1.99"})


def begin_with(file, which: Software) -> None:
    """Let every job of the database have been begun with that software."""
    with sqlite3.connect(file) as connection:
        connection.row_factory = sqlite3.Row
        for row in map(dict, connection.execute("SELECT * FROM beginnings").fetchall()):
            row["software"] = msgspec.json.encode(which).decode()
            values = (row["software"], checksum_of(row), row["job"])
            connection.execute("UPDATE beginnings SET software = ?, checksum = ? WHERE job = ?", values)
    connection.close()


def change(file, sql: str) -> None:
    with sqlite3.connect(file) as connection:
        connection.execute(sql)
    connection.close()


@pytest.fixture
def job(make_scenario):
    return make_job(make_scenario(), "idm", 2.0, "naive", 1, {"budget": 400, "batch_size": 100})


@pytest.mark.parametrize("status", ["running", "paused"])
def test_a_job_of_other_software_needs_a_restart_and_goes_on_where_that_is_back(tmp_path, job, status):
    file = tmp_path / "fleet.sqlite"
    with JobStore(f"sqlite:///{file}") as store:
        store.add_job("a", job, 0, 1.0, "", status)
        begin_with(file, EARLIER)
        assert take_stock(store) == []
        row = store.job("a")
        assert row.status == "needs-restart"
        assert f"here is numpy {software().libraries['numpy']} instead of 1.99" in row.reason
        assert take_stock(store) == []
        assert len(store.events("a")) == 2  # it is said once
        (back,) = take_stock(store, EARLIER)
        assert back.status == status


def test_a_job_whose_question_was_edited_needs_a_restart_by_the_field(tmp_path, job):
    with JobStore(f"sqlite:///{tmp_path / 'fleet.sqlite'}") as store:
        store.add_job("a", job, 0, 1.0, "", "running")
        change(tmp_path / "fleet.sqlite", """UPDATE jobs SET spec = replace(spec, '"seed":1', '"seed":8')""")
        assert take_stock(store) == []
        assert "the database says seed = 8, and it was begun with seed = 1" in store.job("a").reason


def test_a_job_of_before_beginnings_were_written_down_goes_on(tmp_path, job):
    with JobStore(f"sqlite:///{tmp_path / 'fleet.sqlite'}") as store:
        store.add_job("a", job, 0, 1.0, "", "running")
        change(tmp_path / "fleet.sqlite", "DELETE FROM beginnings")
        assert [row.id for row in take_stock(store)] == ["a"]


def test_a_done_job_that_lost_rows_is_run_again_to_the_same_bits(tmp_path, job):
    with light_fleet(tmp_path, POLICY) as fleet:
        first = LightWorker(fleet.port, "w")
        name = fleet.fleet.submit(job).id
        fleet.wait_status(name, "done")
        first.stop()
        told = fleet.fleet.estimate(name)
    change(tmp_path / "fleet.sqlite", "DELETE FROM chunks WHERE start >= 200")
    with light_fleet(tmp_path, POLICY) as fleet:
        assert "taken up again: the record has lost" in fleet.fleet.job(name).reason
        second = LightWorker(fleet.port, "w2")
        fleet.wait_status(name, "done")
        second.stop()
        assert fleet.fleet.estimate(name)["p"] == told["p"]


def test_serve_says_what_needs_a_restart_before_it_begins_and_what_is_damaged(tmp_path, make_scenario):
    scenario = make_scenario({"horizon_s = 10.0": "horizon_s = 1.0"})
    job = make_job(scenario, "idm", 2.0, "naive", 1, {"budget": 300, "batch_size": 100})
    home, port = tmp_path / "fleet", free_port()
    home.mkdir()
    file = home / "fleet.sqlite"
    with JobStore(f"sqlite:///{file}") as store:
        submit(store, job)
        store.add_job("bad", job, 0, 1.0, "", "cancelled")
        store.append([("bad", "estimate", 0, chunk(0), Origin("w", 0))])
        change(file, "UPDATE chunks SET worker = 'x' WHERE job = 'bad'")
        begin_with(file, EARLIER)
        process = serve(home, port)
        process.wait_line("serving on")
        said = "".join(process.lines[: next(i for i, x in enumerate(process.lines) if "serving on" in x)])
        assert f"job {JOB} is needs-restart: it was begun with other software" in said
        assert "1 chunks of 2 jobs were checked before the start" in said
        assert "job bad: the record of rollouts 0 to 4" in said
        assert store.job(JOB).status == "needs-restart"
        process.stop()
        begin_with(file, software())
        process, helper = serve(home, port), worker(port)
        wait(lambda: store.job(JOB).status == "running", (process, helper))
        wait_done(store, (process, helper))
        assert recorded_bits(store)[3] == 300
        helper.stop()
        process.stop()


def test_the_first_look_ends_in_time_with_the_open_jobs_first(tmp_path, job):
    with JobStore(f"sqlite:///{tmp_path / 'fleet.sqlite'}") as store:
        for name, status in (("done", "done"), ("open", "running")):
            store.add_job(name, job, 0, 1.0, "", status)
            store.append([(name, "estimate", 0, chunk(start), Origin("w", 0)) for start in (0, 4, 8)])
        change(tmp_path / "fleet.sqlite", "UPDATE chunks SET worker = 'x' WHERE job = 'open'")
        readings = iter(range(100))
        looked = first_look(store, 5.0, lambda: next(readings))
        assert (looked.chunks, looked.jobs, looked.left) == (4, 1, 1)
        assert looked.damaged[0].startswith("job open: ")
        assert looked.damaged[0].endswith("and 2 more")
