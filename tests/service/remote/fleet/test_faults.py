"""Workers that do wrong in every way, a database that fails, a router that restarts, a clock that jumps: same bits.

Scheduler, database and Zenoh are the real ones; the rollouts are a formula. Processes are killed in test_kills.py.
"""

from __future__ import annotations

import sqlite3
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import msgspec
import numpy as np
import pytest

import ce
from service.errors import StoreError
from service.evaluation.job import Job, make_job
from service.evaluation.store.jobs import JobStore
from service.remote.fleet.messages import (
    MAX_BYTES,
    PREFIX,
    Answer,
    Ask,
    Capabilities,
    Failed,
    Hello,
    Lease,
    Noted,
    Nothing,
    Refused,
    Reply,
    Welcome,
    decode_reply,
)
from service.remote.fleet.policy import Policy
from service.remote.fleet.versions import versions
from service.remote.fleet.zenoh_link import WorkerConnection, client_session
from tests.service.remote.fleet.light import (
    LIMIT_S,
    Gate,
    LightFleet,
    LightRunner,
    LightWorker,
    expected,
    light_answer,
    light_fleet,
)

POLICY = Policy(
    chunk_s=0.5, first_rows=20, max_rows=40, hold_s=0.3, progress_s=0.0, audit_share=0.0, copy_s=0.5
)
PATIENT = replace(POLICY, copy_s=1e6, limit_s=1e6, first_limit_s=1e6)  # nobody is doubted
AUDITED = replace(PATIENT, audit_share=0.2, open_audits=1000)


@pytest.fixture(scope="module")
def job(make_scenario) -> Job:
    return make_job(make_scenario(), "idm", 0.5, "naive", 1, {"budget": 2000, "batch_size": 700})


@pytest.fixture(scope="module")
def right(job) -> ce.Estimate:
    return expected(job)


def assert_same(fleet: LightFleet, job_id: str, right: ce.Estimate) -> None:
    """The bits of one process, and every rollout once in the record."""
    problem, step = fleet.hub.statistics.last(job_id)
    found = problem.algorithm.estimate(step.state)
    assert found.f.tobytes() == right.f.tobytes()
    assert (found.p, found.ci, found.rollouts) == (right.p, right.ci, right.rollouts)
    rows = [
        (p, k, row) for p, k, c in fleet.store.chunks.all_chunks(job_id) for row in range(c.start, c.stop)
    ]
    assert len(rows) == len(set(rows)) == right.rollouts


class Puppet:
    """A worker that says what a test wants it to."""

    def __init__(self, fleet: LightFleet, name: str = "puppet"):
        self.name = name
        self._session = client_session([f"tcp/127.0.0.1:{fleet.port}"])
        self._connection = WorkerConnection(self._session, name)
        assert isinstance(self.hello(versions()), Welcome)

    def hello(self, made_of: dict[str, str]) -> Reply | None:
        return self.say("hello", Hello(self.name, Capabilities(1, ("idm",), False, False, made_of)))

    def say(self, kind: str, message) -> Reply | None:
        return self._connection.ask(kind, message, LIMIT_S)

    def lease(self) -> Lease:
        while not isinstance(reply := self.say("work", Ask(self.name, 0)), Lease):
            assert isinstance(reply, Nothing)
        return reply

    def raw(self, kind: str, payload: bytes) -> Reply:
        (reply,) = self._session.get(f"{PREFIX}/{self.name}/{kind}", payload=payload, timeout=LIMIT_S)
        return decode_reply(reply.ok.payload.to_bytes())

    def close(self) -> None:
        self._session.close()


@contextmanager
def puppet_and_fleet(folder: Path, policy: Policy) -> Iterator[tuple[Puppet, LightFleet]]:
    with light_fleet(folder, policy) as fleet:
        puppet = Puppet(fleet)
        yield puppet, fleet
        puppet.close()


def finish(fleet: LightFleet, job_id: str, workers: int = 1) -> None:
    """Let honest workers do the rest."""
    honest = [LightWorker(fleet.port, f"honest{i}") for i in range(workers)]
    fleet.wait_status(job_id, "done")
    for worker in honest:
        worker.stop()


def test_a_worker_that_hangs_and_answers_late_costs_nothing(tmp_path, job, right):
    with puppet_and_fleet(tmp_path, replace(POLICY, first_limit_s=1.0)) as (puppet, fleet):
        job_id = fleet.fleet.submit(job).id
        lease = puppet.lease()
        finish(fleet, job_id)
        assert puppet.say("answer", light_answer("puppet", lease)) == Noted(False)
        assert_same(fleet, job_id, right)


def test_an_answer_that_comes_twice_counts_once(tmp_path, job, right):
    with puppet_and_fleet(tmp_path, PATIENT) as (puppet, fleet):
        job_id = fleet.fleet.submit(job).id
        answer = light_answer("puppet", puppet.lease())
        assert puppet.say("answer", answer) == Noted(True)
        assert puppet.say("answer", answer) == Noted(False)
        finish(fleet, job_id)
        assert_same(fleet, job_id, right)


def test_a_lease_whose_reply_was_lost_is_given_out_again(tmp_path, job, right):
    with puppet_and_fleet(tmp_path, PATIENT) as (puppet, fleet):
        job_id = fleet.fleet.submit(job).id
        lost, found = puppet.lease(), puppet.lease()
        assert (found.chunk, found.lease != lost.lease) == (lost.chunk, True)
        assert puppet.say("answer", light_answer("puppet", found)) == Noted(True)
        finish(fleet, job_id)
        assert_same(fleet, job_id, right)


def altered(answer: Answer, **changes) -> Answer:
    return msgspec.structs.replace(answer, **changes)


def with_nan(answer: Answer) -> Answer:
    f = np.frombuffer(answer.f).copy()
    f[np.flatnonzero(~np.isnan(f))[0]] = np.nan
    return altered(answer, f=f.tobytes())


BAD_ANSWERS = {
    "NaN of a rollout that went well": with_nan,
    "too few values": lambda a: altered(a, f=a.f[:-8]),
    "half a value": lambda a: altered(a, f=a.f[:-3]),
    "an outcome that is none": lambda a: altered(a, outcomes=b"\x77" + a.outcomes[1:]),
    "negative steps": lambda a: altered(a, steps=b"\xff\xff\xff\xff" + a.steps[4:]),
    "rows that are none": lambda a: altered(a, chunk=msgspec.structs.replace(a.chunk, start=-5)),
    "errors of rollouts that went well": lambda a: altered(a, errors={0: "x"}),
    "errors of rollouts that are not there": lambda a: altered(a, errors={10**6: "x"}),
    "time that is none": lambda a: altered(a, worker_s=float("nan")),
    "another's name": lambda a: altered(a, worker="somebody"),
}


def test_answers_that_cannot_be_true_are_refused_and_three_of_them_are_too_many(tmp_path, job, right):
    with puppet_and_fleet(tmp_path, replace(PATIENT, garbled=len(BAD_ANSWERS))) as (puppet, fleet):
        job_id = fleet.fleet.submit(job).id
        assert puppet.say("answer", light_answer("puppet", puppet.lease())) == Noted(True)
        good = light_answer("puppet", puppet.lease())
        for what, bad in BAD_ANSWERS.items():
            assert isinstance(puppet.say("answer", bad(good)), Refused), what
        fleet.wait(lambda told: any(e.kind == "quarantine" for e in told))
        reply = puppet.say("answer", good)
        assert isinstance(reply, Refused)
        assert "in quarantine" in reply.reason
        finish(fleet, job_id)
        assert_same(fleet, job_id, right)  # what it had answered before was run again


@pytest.mark.parametrize("payload", [b"", b"\xc1", b"\x00" * 1000, b"\x81\xa4kind\xa6answer", b"\x91" * 5000])
def test_garbage_is_refused_with_a_reason(tmp_path, payload):
    with puppet_and_fleet(tmp_path, POLICY) as (puppet, _):
        for kind in ("hello", "work", "answer", "nonsense"):
            assert isinstance(puppet.raw(kind, payload), Refused)


def test_a_message_that_is_too_long_is_refused_unread(tmp_path):
    with puppet_and_fleet(tmp_path, POLICY) as (puppet, _):
        reply = puppet.raw("answer", bytes(MAX_BYTES + 1))
        assert isinstance(reply, Refused)
        assert str(MAX_BYTES) in reply.reason


class Wrong(LightRunner):
    """Its values are off by the smallest amount there is. It holds its first chunk until others are at work."""

    leased = threading.Event()
    others_work = threading.Event()

    def run(self, lease: Lease) -> Answer:
        self.leased.set()
        assert self.others_work.wait(LIMIT_S)
        good = light_answer(self.worker, lease)
        return altered(good, f=np.nextafter(np.frombuffer(good.f), np.inf).tobytes())


def test_wrong_values_are_found_by_an_audit_and_all_of_that_worker_s_chunks_are_run_again(
    tmp_path, job, right
):
    # the job cannot end without the wrong one's chunk
    patient = replace(PATIENT, audit_share=0.2, open_audits=1000)
    with light_fleet(tmp_path, patient) as fleet:
        job_id = fleet.fleet.submit(job).id
        wrong = LightWorker(fleet.port, "wrong", Wrong)
        assert Wrong.leased.wait(LIMIT_S)
        honest = [LightWorker(fleet.port, f"honest{i}") for i in range(2)]
        fleet.wait_rollouts(job_id, 200)
        Wrong.others_work.set()
        wrong.join()
        fleet.wait_status(job_id, "done")
        for worker in honest:
            worker.stop()
        assert "are not those of a replay on the scheduler's machine" in wrong.refusal
        assert_same(fleet, job_id, right)
        assert [w.id for w in fleet.fleet.workers() if w.quarantine] == ["wrong"]
    with JobStore(f"sqlite:///{tmp_path / 'fleet.sqlite'}") as store:
        assert list(store.quarantined()) == ["wrong"]
        assert store.epoch(job_id) == 1


def test_a_worker_of_another_version_is_refused_with_what_differs(tmp_path):
    with light_fleet(tmp_path, POLICY) as fleet:
        worker = LightWorker(fleet.port, "old", made_of=versions() | {"numpy": "1.99"})
        worker.join()
        assert "worker old has numpy 1.99, the scheduler" in worker.refusal
        assert fleet.fleet.workers() == []


class Unable(LightRunner):
    """Has not the job's files."""

    def open(self, spec) -> str:
        return "the road 'mine.net.xml' differs"


def test_a_worker_that_cannot_open_the_job_leaves_it_to_others_and_says_why(tmp_path, job, right):
    with light_fleet(tmp_path, POLICY) as fleet:
        job_id = fleet.fleet.submit(job).id
        unable = LightWorker(fleet.port, "unable", Unable)
        fleet.wait(lambda told: any(e.kind == "refused" for e in told))
        assert fleet.fleet.job(job_id).refusals == {"unable": "the road 'mine.net.xml' differs"}
        finish(fleet, job_id)
        unable.stop()
        assert_same(fleet, job_id, right)


class OtherDraws(LightRunner):
    """Its machine's random numbers are others: it needs the rows themselves."""

    def run(self, lease: Lease) -> Answer | Failed:
        if not hasattr(lease.rows, "x"):
            return Failed(self.worker, lease.lease, lease.chunk, "other draws", explicit=True)
        return light_answer(self.worker, lease)


def test_a_worker_that_draws_other_rows_is_sent_the_rows(tmp_path, job, right):
    with light_fleet(tmp_path, POLICY) as fleet:
        job_id = fleet.fleet.submit(job).id
        worker = LightWorker(fleet.port, "other", OtherDraws)
        fleet.wait_status(job_id, "done")
        worker.stop()
        assert_same(fleet, job_id, right)


@contextmanager
def held_up(tmp_path, job, right, workers: int, **others):
    """A fleet with its job, and advance(rollouts), which lets workers go on for ten chunks until it has so many.

    At the end they go on for good, and the job must end with the right bits.
    """
    with light_fleet(tmp_path, POLICY, **others) as fleet:
        job_id = fleet.fleet.submit(job).id
        gate = Gate()
        crew = [LightWorker(fleet.port, f"w{i}", gate.runner) for i in range(workers)]

        def advance(rollouts: int) -> None:
            gate.let(10)  # of 20 rows or more
            fleet.wait_rollouts(job_id, rollouts)

        yield fleet, job_id, gate, advance
        gate.open()
        fleet.wait_status(job_id, "done")
        for worker in crew:
            worker.stop()
        assert_same(fleet, job_id, right)


def test_a_router_that_is_restarted_is_found_again(tmp_path, job, right):
    with held_up(tmp_path, job, right, 2) as (fleet, _, _, advance):
        for rollouts in (200, 400):
            advance(rollouts)
            fleet.shut()
            fleet.open()


def test_a_locked_database_holds_things_up_and_loses_nothing(tmp_path, job, right):
    with held_up(tmp_path, job, right, 1) as (fleet, job_id, gate, advance):
        advance(200)
        other = sqlite3.connect(tmp_path / "fleet.sqlite", isolation_level=None)
        other.execute("BEGIN IMMEDIATE")
        gate.open()
        deadline = time.monotonic() + LIMIT_S
        while not fleet.hub.call(lambda scheduler: scheduler.trouble).result():
            assert time.monotonic() < deadline
        with pytest.raises(StoreError, match="database is locked"):
            fleet.store.add_event(job_id, "note", {})
        other.execute("ROLLBACK")
        other.close()


@pytest.mark.parametrize("jump_s", [-1e7, 1e7])
def test_clock_jumps_cost_time_at_most(tmp_path, job, right, jump_s):
    jumped = [0.0]

    def clock() -> float:
        return time.monotonic() + jumped[0]

    with held_up(tmp_path, job, right, 2, clock=clock) as (_, _, _, advance):
        for rollouts in (200, 400, 600):
            advance(rollouts)
            jumped[0] += jump_s


@pytest.mark.parametrize("workers", [1, 4])
def test_the_number_of_workers_does_not_change_a_bit(tmp_path, job, right, workers):
    with light_fleet(tmp_path, AUDITED) as fleet:
        job_id = fleet.fleet.submit(job).id
        finish(fleet, job_id, workers)
        assert_same(fleet, job_id, right)


def test_a_job_can_be_paused_resumed_and_cancelled(tmp_path, job, right):
    with puppet_and_fleet(tmp_path, replace(POLICY, hold_s=0.3)) as (puppet, fleet):
        job_id = fleet.fleet.submit(job).id
        puppet.lease()
        fleet.fleet.pause(job_id)
        fleet.wait_status(job_id, "paused")
        assert puppet.say("work", Ask("puppet", 0)) == Nothing()
        assert fleet.fleet.job(job_id).status == "paused"
        fleet.fleet.resume(job_id)
        late = light_answer("puppet", puppet.lease())
        fleet.fleet.cancel(job_id)
        fleet.wait_status(job_id, "cancelled")
        assert puppet.say("answer", late) == Noted(False)
        assert [e.body["status"] for e in fleet.fleet.events(job_id)] == [
            "running",
            "paused",
            "running",
            "cancelled",
        ]


def test_a_worker_told_to_stop_answers_what_it_runs_and_leaves(tmp_path, job):
    with light_fleet(tmp_path, replace(PATIENT, audit_share=0.0)) as fleet:
        job_id = fleet.fleet.submit(job).id
        worker = LightWorker(fleet.port, "w", procs=2)
        fleet.wait_rollouts(job_id, 100)
        worker.stop()
        assert fleet.fleet.workers() == []
        assert fleet.fleet.job(job_id).leases == 0
