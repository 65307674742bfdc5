"""Chunks and iterations carry a checksum over all they say, checked on every read."""

from __future__ import annotations

import logging
import os
import sqlite3
from dataclasses import replace

import numpy as np
import pytest
import sqlalchemy as sa

import ce
from service.errors import StoreError
from service.evaluation.store import Chunk, Origin, RunDirectory
from service.evaluation.store.jobs import JobStore
from service.evaluation.store.tables import chunks, iterations

CHUNK = Chunk(
    8, 12, np.array([0.5, np.nan, np.inf, -0.0]), np.array([0, 255, 1, 2], np.uint8), np.arange(4, dtype=np.int32),
    {1: "lost"}, 0.25, "0123"
)  # fmt: skip
CHANGES = {
    "job": "b",
    "phase": "estimate",
    "iteration": 1,
    "start": 9,
    "epoch": 1,
    "stop": 13,
    "f": np.array([0.5, np.nan, np.inf, 0.0]).tobytes(),
    "outcomes": bytes([0, 255, 1, 3]),
    "steps": np.array([0, 1, 2, 4], np.int32).tobytes(),
    "errors": '{"1":"host"}',
    "worker_s": 0.5,
    "digest": "0124",
    "worker": "x",
    "checksum": "00",
    "in_sumo": 2,
    "contacts": '{"3":{}}',
}


@pytest.fixture
def store(url, job):
    with JobStore(url) as store:
        for name in "ab":
            store.add_job(name, job, 0, 1.0, "", "running")
        store.append([("a", "train", 0, CHUNK, Origin("w", 0))])
        yield store


def test_what_is_written_is_read_and_its_draws_with_it(store):
    ((read, origin),) = store.chunks.chunks("a", "train", 0)
    assert (read.f.tobytes(), read.draws, origin) == (CHUNK.f.tobytes(), "0123", Origin("w", 0))
    assert store.chunks.without_checksum() == 0


def test_every_column_of_a_chunk_is_under_its_checksum():
    assert set(CHANGES) == {column.name for column in chunks.columns}


@pytest.mark.parametrize("column", CHANGES)
def test_a_chunk_of_which_anything_was_changed_is_refused_whoever_reads_it(store, column):
    with store._engine.begin() as connection:
        connection.execute(sa.update(chunks).values({column: CHANGES[column]}))
    with pytest.raises(StoreError, match="is damaged; `tailroad verify` says what else is"):
        list(store.chunks.all_chunks("b" if column == "job" else "a"))


def test_bits_of_f_that_flip_are_found_wherever_they_are(store):
    for bit in range(64 * CHUNK.f.size):
        flipped = bytearray(CHUNK.f.tobytes())
        flipped[bit // 8] ^= 1 << bit % 8
        with store._engine.begin() as connection:
            connection.execute(sa.update(chunks).values(f=bytes(flipped)))
        with pytest.raises(StoreError, match="is damaged"):
            store.chunks.chunks("a", "train", 0)
        with pytest.raises(StoreError, match="is damaged"):
            store.cost("a")


@pytest.mark.parametrize("column", ["job", "number", "record", "at", "checksum"])
def test_an_iteration_of_which_anything_was_changed_is_refused(store, column):
    store.add_iterations("a", 0, 0, [ce.EstimationRecord(0, 100, 0.5, 0.1, 0.4, 0.6, 50.0, 0.01, 50, 0)])
    assert store.iterations("a")[0]["p"] == 0.5
    change = {
        "job": "b",
        "number": 1,
        "record": sa.func.replace(iterations.c.record, "0.5", "0.6"),
        "at": "",
        "checksum": "0",
    }
    with store._engine.begin() as connection:
        connection.execute(sa.update(iterations).values({column: change[column]}))
    with pytest.raises(
        StoreError, match=r"the record of what batch \d came to is damaged|of job . came to is damaged"
    ):
        store.iterations("b" if column == "job" else "a")


def test_records_of_before_there_were_checksums_are_read_and_said_to_be(tmp_path, job, caplog):
    with RunDirectory.create(tmp_path / "run", (job,)) as run:
        run.append("naive", "estimate", 0, CHUNK)
    with sqlite3.connect(tmp_path / "run" / "rollouts.sqlite") as connection:
        connection.execute("UPDATE chunks SET checksum = '', worker = 'somebody'")
    with caplog.at_level(logging.WARNING), RunDirectory.open(tmp_path / "run") as run:
        assert run.chunks("naive", "estimate", 0)[0].f.tobytes() == CHUNK.f.tobytes()
    assert "1 chunks of rollouts were recorded before there were checksums" in caplog.text


@pytest.mark.parametrize("what", ["missing", "empty", "without tables"])
def test_a_record_that_is_missing_or_empty_is_refused_and_not_made_anew(tmp_path, job, what):
    with RunDirectory.create(tmp_path / "run", (job,)) as run:
        run.append("naive", "estimate", 0, CHUNK)
    file = tmp_path / "run" / "rollouts.sqlite"
    file.unlink()
    if what == "empty":
        file.touch()
    if what == "without tables":
        sqlite3.connect(file).execute("PRAGMA user_version = 1").connection.close()
    before = file.read_bytes() if file.exists() else None
    match = (
        "holds no record of rollouts"
        if what == "without tables"
        else f"is {what}: the rollouts of this run are gone"
    )
    for _ in range(2):
        with pytest.raises(StoreError, match=match):
            RunDirectory.open(tmp_path / "run")
        with pytest.raises(StoreError, match="holds a run already"):
            RunDirectory.create(tmp_path / "run", (job,))
    assert (file.read_bytes() if file.exists() else None) == before or what == "without tables"


def test_a_new_run_does_not_take_over_rollouts_that_lost_their_description(tmp_path, job):
    with RunDirectory.create(tmp_path / "run", (job,)) as run:
        run.append("naive", "estimate", 0, CHUNK)
    os.remove(tmp_path / "run" / "run.json")
    with pytest.raises(StoreError, match=r"holds rollouts, and the run\.json that says of what is not there"):
        RunDirectory.create(tmp_path / "run", (job,))


def test_a_run_that_was_killed_before_it_was_described_is_begun_again(tmp_path, job):
    RunDirectory.create(tmp_path / "run", (job,)).close()
    os.remove(tmp_path / "run" / "run.json")
    with RunDirectory.create(tmp_path / "run", (job,)) as run:
        run.append("naive", "estimate", 0, replace(CHUNK, draws=""))
        assert len(run.chunks("naive", "estimate", 0)) == 1
