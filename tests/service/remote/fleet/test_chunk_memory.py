"""Who asks for an estimate again has only the new chunks read, and is told the same."""

from __future__ import annotations

import numpy as np
import pytest

from service.evaluation.job import make_job
from service.evaluation.store import Chunk, Origin
from service.evaluation.store import records as module
from service.evaluation.store.jobs import JobStore
from service.remote.fleet.chunk_memory import ChunkMemory
from service.remote.fleet.policy import Policy
from tests.service.remote.fleet.light import LightWorker, light_fleet


def chunk(start: int, n: int = 10) -> Chunk:
    f = np.arange(start, start + n) / 100.0
    return Chunk(start, start + n, f, np.full(n, 2, np.uint8), np.full(n, 3, np.int32), {}, 0.5, "d")


@pytest.fixture
def reads(monkeypatch) -> list[int]:
    """The start of every chunk that is read from the database."""
    found: list[int] = []
    read = module.chunk_of

    def counted(row):
        found.append(row.start)
        return read(row)

    monkeypatch.setattr(module, "chunk_of", counted)
    return found


@pytest.fixture
def store(tmp_path, make_scenario):
    job = make_job(make_scenario(), "idm", 0.5, "naive", 1, {"budget": 100})
    with JobStore(f"sqlite:///{tmp_path / 'fleet.sqlite'}") as store:
        for name in ("j", "k"):
            store.add_job(name, job, 0, 1.0, "", "running")
        store.append([("j", "estimate", 0, chunk(start), Origin("w", 0)) for start in (0, 10, 20)])
        yield store


def same(memory: ChunkMemory, store: JobStore, job: str = "j") -> None:
    """What is remembered is what is in the record."""
    told, there = memory.of(job), list(store.chunks.all_chunks(job))
    assert [(p, k, c.start, c.f.tobytes(), c.outcomes.tobytes()) for p, k, c in told.chunks] == [
        (p, k, c.start, c.f.tobytes(), c.outcomes.tobytes()) for p, k, c in there
    ]
    assert (told.worker_s, told.steps, told.in_sumo) == store.cost(job)


def test_only_new_chunks_are_read_and_void_ones_are_forgotten(store, reads):
    memory = ChunkMemory(store.chunks)
    memory.of("j")
    assert reads == [0, 10, 20]
    reads.clear()
    memory.of("j")
    assert reads == []
    store.append([("j", "estimate", 0, chunk(30), Origin("bad", 0))])
    memory.of("j")
    assert reads == [30]
    same(memory, store)
    assert store.quarantine("bad", "a test") == ["j"]
    assert [c.start for *_, c in memory.of("j").chunks] == [0, 10, 20]
    store.append(
        [("j", "estimate", 0, chunk(30), Origin("w", 1)), ("j", "estimate", 1, chunk(0), Origin("w", 1))]
    )
    same(memory, store)


def test_jobs_asked_for_longest_ago_are_forgotten_first(store, reads):
    memory = ChunkMemory(store.chunks, most=35)
    store.append([("k", "estimate", 0, chunk(0), Origin("w", 0))])
    memory.of("j")
    memory.of("k")
    reads.clear()
    same(memory, store, "k")
    reads.clear()
    memory.of("j")
    assert reads == [0, 10, 20]


def test_an_estimate_that_is_asked_for_again_reads_no_chunk(tmp_path, make_scenario, reads):
    job = make_job(make_scenario(), "idm", 2.0, "naive", 1, {"budget": 400, "batch_size": 100})
    with light_fleet(tmp_path, Policy(first_rows=20, max_rows=40, hold_s=0.3, audit_share=0.0)) as fleet:
        name = fleet.fleet.submit(job).id
        worker = LightWorker(fleet.port, "w")
        fleet.wait_status(name, "done")
        worker.stop()
        fleet.hub.statistics.keep(name)
        told = fleet.fleet.estimate(name)
        reads.clear()
        assert fleet.fleet.estimate(name) == told
        assert reads == []
