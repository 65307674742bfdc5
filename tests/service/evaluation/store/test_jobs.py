"""The record of a fleet, the same in SQLite and in a real PostgreSQL."""

from __future__ import annotations

import threading
from dataclasses import replace

import pytest
import sqlalchemy as sa

import ce
from service.errors import StoreError
from service.evaluation.store import Chunk, Origin
from service.evaluation.store.jobs import AuditRow, JobStore
from service.evaluation.store.notes import NOTE, Said
from service.evaluation.store.tables import jobs
from tests.service.evaluation.store.test_directory import chunk


@pytest.fixture
def store(url, job):
    with JobStore(url) as store:
        store.add_job("a", job, 3, 2.0, "first", "running")
        yield store


def bits(c: Chunk) -> tuple:
    return c.start, c.stop, c.f.tobytes(), c.outcomes.tobytes(), c.steps.tobytes(), c.errors, c.worker_s


def put(store: JobStore, job: str, one: Chunk, worker: str = "w", epoch: int = 0, iteration: int = 0) -> None:
    store.append([(job, "train", iteration, replace(one, draws=f"digest{one.start}"), Origin(worker, epoch))])


def test_jobs_come_back_as_they_were_submitted_in_order(store, job):
    store.add_job("b", job, 0, 1.0, "", "paused")
    first, second = store.jobs()
    assert (first.id, first.job, first.priority, first.weight, first.label) == ("a", job, 3, 2.0, "first")
    assert (first.status, second.status, second.number) == ("running", "paused", first.number + 1)
    assert store.jobs(after=first.number) == [second]
    assert store.job("a") == first
    assert store.job("c") is None
    with pytest.raises(StoreError, match="there is a job 'a' already"):
        store.add_job("a", job, 0, 1.0, "", "running")


def test_the_last_status_counts_and_all_are_kept(store):
    store.add_event("a", "status", {"status": "paused", "reason": "lunch"})
    store.add_event("a", "refused", {"worker": "w"})
    assert (store.job("a").status, store.job("a").reason) == ("paused", "lunch")
    assert [e.kind for e in store.events("a")] == ["status", "status", "refused"]
    assert [e.number for e in store.events("a", after=1)] == [2, 3]
    assert [row.id for row in store.jobs_with(["paused"])] == ["a"]
    assert store.jobs_with(["running"]) == []


def test_the_last_note_counts_and_earlier_ones_are_kept(store, job):
    store.add_job("j", job, 0, 1.0, "", "done")
    assert store.job("j").note == Said()
    store.add_event("j", NOTE, {"text": "first", "tags": ["a"], "archived": False})
    store.add_event("j", NOTE, {"text": "second"})
    assert store.job("j").note == Said("second")
    assert [event.body["text"] for event in store.events_of("j", NOTE)] == ["first", "second"]
    assert store.jobs()[-1].note.text == "second"


def test_jobs_are_listed_with_their_status_in_one_query(store, job):
    for name in "bcd":
        store.add_job(name, job, 0, 1.0, "", "running")
    store.add_event("c", "status", {"status": "done", "reason": ""})
    asked = []
    sa.event.listen(
        store._engine, "before_cursor_execute", lambda _1, _2, statement, *_: asked.append(statement)
    )
    assert [row.status for row in store.jobs()] == ["running", "running", "done", "running"]
    assert sum(statement.startswith("SELECT") for statement in asked) == 1


def test_jobs_of_other_statuses_are_not_read_to_find_those_of_one(store, job):
    store.add_job("b", job, 0, 1.0, "", "done")
    with store._engine.begin() as connection:
        connection.execute(sa.update(jobs).where(jobs.c.id == "b").values(spec="not JSON"))
    assert [row.id for row in store.jobs_with(["running"])] == ["a"]
    with pytest.raises(StoreError, match="the question of job b is damaged in the database"):
        store.jobs_with(["done"])


def test_chunks_come_back_to_the_bit_with_where_they_come_from(store):
    written = [chunk(start, n) for start, n in ((30, 10), (0, 1), (1, 5), (6, 24))]
    for one in written:
        put(store, "a", one)
    read = store.chunks.chunks("a", "train", 0, 0, 40)
    assert [bits(c) for c, _ in read] == [bits(c) for c in sorted(written, key=lambda c: c.start)]
    assert (read[0][0].draws, read[0][1]) == ("digest0", Origin("w", 0))
    assert [c.start for c, _ in store.chunks.chunks("a", "train", 0, 6, 30)] == [6]
    assert store.chunks.chunks("a", "train", 1) == store.chunks.chunks("b", "train", 0) == []


def test_the_first_answer_for_a_chunk_is_kept(store):
    put(store, "a", chunk(8, 8))
    put(store, "a", chunk(8, 8, seed=1), worker="other")
    ((read, origin),) = store.chunks.chunks("a", "train", 0)
    assert bits(read) == bits(chunk(8, 8))
    assert origin.worker == "w"


def test_what_a_wrong_worker_did_is_void_unless_somebody_confirmed_it(store, job):
    store.add_job("b", job, 0, 1.0, "", "running")
    for start in (0, 10, 20):
        put(store, "a", chunk(start, 10), worker="wrong" if start else "good")
    put(store, "b", chunk(0, 5), worker="good")
    store.add_audits([AuditRow("a", "train", 0, 10, 0, "good")])
    assert store.quarantine("wrong", "its values differ") == ["a"]
    assert [c.start for c, _ in store.chunks.chunks("a", "train", 0)] == [0, 10]
    assert (store.epoch("a"), store.epoch("b")) == (1, 0)
    assert store.quarantined() == {"wrong": "its values differ"}
    put(store, "a", chunk(20, 10, seed=2), epoch=1)
    read = store.chunks.chunks("a", "train", 0)
    assert [bits(c) for c, _ in read][-1] == bits(chunk(20, 10, seed=2))
    assert store.quarantine("wrong", "again") == ["a"]  # as where the database's first answer was lost
    assert store.epoch("a") == 1


def test_a_done_job_that_loses_rollouts_is_running_again_by_the_same_transaction(store, job):
    store.add_job("b", job, 0, 1.0, "", "running")
    for name in "ab":
        put(store, name, chunk(0, 10), worker="wrong")
        store.add_event(name, "status", {"status": "done" if name == "a" else "cancelled", "reason": ""})
    assert store.quarantine("wrong", "its values differ") == ["a", "b"]
    assert (store.job("a").status, store.job("b").status) == ("running", "cancelled")
    assert store.job("a").reason == "taken up again: rollouts of worker wrong are void"


def test_iterations_are_of_the_present_epoch(store):
    record = ce.EstimationRecord(0, 100, 0.5, 0.1, 0.4, 0.6, 50.0, 0.01, 50, 0)
    store.add_iterations("a", 0, 0, [record, record])
    store.add_iterations("a", 0, 1, [record])
    assert [r["number"] for r in store.iterations("a")] == [0, 1]
    assert store.iterations("a", after=0)[0]["p"] == 0.5
    put(store, "a", chunk(0, 10), worker="wrong")
    store.quarantine("wrong", "")
    assert store.iterations("a") == []


def test_cost_is_summed_over_what_is_not_void(store):
    both = chunk(0, 4), chunk(4, 3)
    for one in both:
        put(store, "a", one)
    assert store.cost("a") == (0.5, sum(int(one.steps.sum()) for one in both), 7)


def test_one_scheduler_at_a_time(store, url):
    claim = store.claim()
    with JobStore(url) as other, pytest.raises(StoreError, match="another scheduler works on"):
        other.claim()
    claim.close()
    with JobStore(url) as other:
        other.claim().close()


def test_several_writers_and_readers_at_once_lose_nothing(store, url):
    def write(worker: int) -> None:
        with JobStore(url) as own:
            for i in range(20):
                put(own, "a", chunk(100 * worker + i, 1), worker=f"w{worker}")

    threads = [threading.Thread(target=write, args=(i,)) for i in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(store.chunks.chunks("a", "train", 0)) == 80


def test_a_database_that_is_not_there_is_a_clear_error(tmp_path):
    with pytest.raises(StoreError, match="cannot open postgresql\\+psycopg://nobody:\\*\\*\\*@"):
        JobStore("postgresql+psycopg://nobody:secret@127.0.0.1:9/none")
    with pytest.raises(StoreError, match="not a database URL"):
        JobStore("nonsense")
    with pytest.raises(StoreError, match="not a database URL: mysql is not a kind"):
        JobStore("mysql://localhost/x")
    with pytest.raises(StoreError, match="cannot open"):
        JobStore(f"sqlite:///{tmp_path / 'no' / 'folder' / 'x.sqlite'}")
