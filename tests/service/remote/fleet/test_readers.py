"""Whoever asks what a job comes to, at whatever moment, changes nothing of what it comes to."""

from __future__ import annotations

import logging
import sqlite3
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace

import msgspec
import pytest

from service.evaluation.job import Problem, make_job
from service.evaluation.store.jobs import JobStore
from service.evaluation.store.states import LastState
from service.remote.fleet import events as E
from service.remote.fleet.policy import Policy
from service.remote.fleet.statistics import Statistics
from tests.service.remote.fleet.light import LIMIT_S, Gate, LightFleet, LightWorker, expected, light_fleet

POLICY = Policy(chunk_s=0.5, first_rows=20, max_rows=40, hold_s=0.3, audit_share=0.0)


@contextmanager
def readers(fleet: LightFleet, job: str) -> Iterator[None]:
    """While this lasts, estimate, curve and iterations are asked for without a pause."""
    over, failed = threading.Event(), []

    def read() -> None:
        while not over.is_set():
            try:
                fleet.fleet.estimate(job)
                fleet.fleet.curve(job, [0.5, 1.0])
                fleet.fleet.iterations(job)
            except Exception as error:
                failed.append(error)
                return

    threads = [threading.Thread(target=read) for _ in range(2)]
    for thread in threads:
        thread.start()
    yield
    over.set()
    for thread in threads:
        thread.join()
    assert failed == []


@pytest.mark.parametrize("method", ["naive", "ce"])
def test_readers_after_submission_and_while_the_service_comes_back_leave_the_result_as_it_is(
    tmp_path, make_scenario, method
):
    options = {"budget": 1000}
    if method == "ce":
        options |= {"iterations": 2, "samples_per_iteration": 100}
    job = make_job(make_scenario(), "idm", 2.0, method, 1, options)
    right, gate = expected(job), Gate()
    with light_fleet(tmp_path, POLICY) as fleet:
        name = fleet.fleet.submit(job).id
        with readers(fleet, name):
            worker = LightWorker(fleet.port, "w", gate.runner)
            gate.let(6)
            fleet.wait_rollouts(name, 120)
    worker.vanish()
    with light_fleet(tmp_path, POLICY) as fleet:
        with readers(fleet, name):
            gate.open()
            worker = LightWorker(fleet.port, "w2")
            fleet.wait_status(name, "done")
        worker.stop()
        told = fleet.fleet.estimate(name)
        assert (told["p"], told["rollouts"]["total"]) == (right.p, right.rollouts)
    with light_fleet(tmp_path, POLICY) as fleet:
        assert fleet.fleet.estimate(name) == told


def done_job(folder, make_scenario) -> tuple[str, dict]:
    """A job that is done and whose state is kept, and its estimate."""
    job = make_job(make_scenario(), "idm", 2.0, "naive", 1, {"budget": 400, "batch_size": 100})
    with light_fleet(folder, POLICY) as fleet:
        worker = LightWorker(fleet.port, "w")
        name = fleet.fleet.submit(job).id
        fleet.wait_status(name, "done")
        worker.stop()
        fleet.hub.statistics.keep(name)
        return name, fleet.fleet.estimate(name)


def early_state(folder, name: str) -> bytes:
    """Of the job before its first batch."""
    with JobStore(f"sqlite:///{folder / 'fleet.sqlite'}") as store:
        problem = Problem(store.job(name).job)
    return problem.algorithm.to_bytes(problem.algorithm.init(problem.stream_seed))


def test_a_database_that_holds_a_wrong_last_state_is_healed_at_start_and_says_so(
    tmp_path, make_scenario, caplog
):
    name, told = done_job(tmp_path, make_scenario)
    with sqlite3.connect(tmp_path / "fleet.sqlite") as connection:  # as an earlier tailroad left it
        wrong = (early_state(tmp_path, name),)
        connection.execute("UPDATE states SET state = ?, number = 0, record = '', checksum = ''", wrong)
    with caplog.at_level(logging.WARNING), light_fleet(tmp_path, POLICY) as fleet:
        fleet.hub._healing.join(LIMIT_S)
        kept = fleet.store.states.kept(name, 0)
        assert kept.sound
        assert kept.last.record == fleet.store.chunks.digest(name)
        assert fleet.fleet.estimate(name) == told
    assert f"job {name}: the state kept of it (after 0 batches) was not used" in caplog.text
    assert "it is made again from the job's chunks (after 4 batches)" in caplog.text


@pytest.mark.parametrize(
    ("what", "said"),
    [("number", "it is of 3 batches, and the job has 4"), ("record", "it is not of the job's record")],
)
def test_a_kept_state_that_does_not_match_the_record_is_never_used(
    tmp_path, make_scenario, caplog, what, said
):
    name, told = done_job(tmp_path, make_scenario)
    state = early_state(tmp_path, name)
    with JobStore(f"sqlite:///{tmp_path / 'fleet.sqlite'}") as store:
        record = store.chunks.digest(name)
        wrong = LastState(
            name, 0, 3 if what == "number" else 4, record if what == "number" else "0" * 32, state
        )
    with sqlite3.connect(tmp_path / "fleet.sqlite") as connection:
        values = (state, wrong.number, wrong.record, wrong.checksum())
        connection.execute("UPDATE states SET state = ?, number = ?, record = ?, checksum = ?", values)
    with caplog.at_level(logging.WARNING), light_fleet(tmp_path, POLICY) as fleet:
        assert fleet.fleet.estimate(name) == told
    assert said in caplog.text


def test_a_kept_state_of_an_earlier_format_is_made_again_to_the_same_bits(tmp_path, make_scenario, caplog):
    name, told = done_job(tmp_path, make_scenario)
    with JobStore(f"sqlite:///{tmp_path / 'fleet.sqlite'}") as store:
        last = store.states.kept(name, 0).last
        earlier = msgspec.msgpack.encode(msgspec.msgpack.decode(last.state) | {"format": 3})
        store.states.keep(LastState(name, 0, last.number, last.record, earlier), unreadable=last.state)
    with caplog.at_level(logging.WARNING), light_fleet(tmp_path, POLICY) as fleet:
        assert fleet.fleet.estimate(name) == told
        fleet.hub._healing.join(LIMIT_S)
        assert fleet.store.states.kept(name, 0).last.state == last.state
    assert "the state has format 3, this version reads" in caplog.text


def test_a_kept_state_of_which_a_bit_was_flipped_is_never_used(tmp_path, make_scenario):
    name, told = done_job(tmp_path, make_scenario)
    with sqlite3.connect(tmp_path / "fleet.sqlite") as connection:
        (state,) = connection.execute("SELECT state FROM states").fetchone()
        for bit in range(0, 8 * len(state), 8 * len(state) // 20):
            flipped = bytearray(state)
            flipped[bit // 8] ^= 1 << bit % 8
            connection.execute("UPDATE states SET state = ?", (bytes(flipped),))
            connection.commit()
            with JobStore(f"sqlite:///{tmp_path / 'fleet.sqlite'}") as store:
                assert not store.states.kept(name, 0).sound
    with light_fleet(tmp_path, POLICY) as fleet:
        assert fleet.fleet.estimate(name) == told


def test_the_state_of_an_open_job_is_not_written_down_by_whoever_asks(tmp_path, make_scenario):
    job = make_job(make_scenario(), "idm", 2.0, "naive", 1, {"budget": 400, "batch_size": 100})
    with JobStore(f"sqlite:///{tmp_path / 'fleet.sqlite'}") as store:
        statistics = Statistics(store)
        for status in ("running", "paused"):
            store.add_job(status, job, 0, 1.0, "", status)
            assert statistics.last(status)[1].number == 0
            assert store.states.kept(status, 0) is None
        store.add_event("paused", "status", {"status": "cancelled", "reason": ""})
        statistics.last("paused")
        assert store.states.kept("paused", 0).sound


@pytest.mark.parametrize("killed", [False, True])
def test_a_done_job_that_loses_rollouts_is_run_again_even_if_the_service_is_killed_at_that_moment(
    tmp_path, make_scenario, killed
):
    name, told = done_job(tmp_path, make_scenario)
    if killed:  # right after it has voided them
        with JobStore(f"sqlite:///{tmp_path / 'fleet.sqlite'}") as store:
            assert store.quarantine("w", "a test") == [name]
    with light_fleet(tmp_path, replace(POLICY, garbled=1)) as fleet:
        if not killed:
            wrong = LightWorker(fleet.port, "w")
            deadline = time.monotonic() + LIMIT_S
            while "w" not in {known.id for known in fleet.fleet.workers()}:
                assert time.monotonic() < deadline
            fleet.hub.post(E.Garbled("w", "a test"))
            wrong.join()
        worker = LightWorker(fleet.port, "other")
        fleet.wait_status(name, "done")
        worker.stop()
        assert fleet.store.epoch(name) == 1
        assert {origin.worker for *_, origin in fleet.store.chunks.with_origins(name)} == {"other"}
        assert fleet.fleet.estimate(name)["p"] == told["p"]
