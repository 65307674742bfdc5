"""Schema versions: what an earlier tailroad wrote is migrated and kept; what a later one wrote is refused."""

from __future__ import annotations

import sqlite3
from pathlib import Path

import msgspec
import numpy as np
import pytest
import sqlalchemy as sa
from alembic.autogenerate import compare_metadata
from alembic.migration import MigrationContext

from service.errors import StoreError
from service.evaluation.job import make_job
from service.evaluation.store import RunDirectory
from service.evaluation.store.database import open_engine
from service.evaluation.store.tables import VERSION, metadata

FIRST = """CREATE TABLE chunks (job TEXT NOT NULL, phase TEXT NOT NULL, iteration INTEGER NOT NULL,
    start INTEGER NOT NULL, stop INTEGER NOT NULL, f BLOB NOT NULL, outcomes BLOB NOT NULL, steps BLOB NOT NULL,
    errors TEXT NOT NULL, worker_s FLOAT NOT NULL, PRIMARY KEY (job, phase, iteration, start))"""


def first_version(file: Path) -> None:
    """A record as tailroad wrote it before there were versions."""
    f = np.array([0.5, np.nan, -0.0], "<f8").tobytes()
    with sqlite3.connect(file) as connection:
        connection.execute(FIRST)
        row = ("naive", "estimate", 0, 7, 10, f, bytes([0, 255, 2]), bytes(12), '{"1":"lost"}', 0.25)
        connection.execute(f"INSERT INTO chunks VALUES ({','.join('?' * 10)})", row)
    connection.close()


def test_a_new_database_and_a_migrated_one_have_the_same_tables(url, tmp_path):
    if url.startswith("sqlite"):
        first_version(tmp_path / "jobs.sqlite")
    else:
        engine = sa.create_engine(url)
        with engine.begin() as connection:
            connection.exec_driver_sql(FIRST.replace("BLOB", "BYTEA"))
        engine.dispose()
    engine = open_engine(url)
    with engine.connect() as connection:
        assert compare_metadata(MigrationContext.configure(connection), metadata) == []
        assert connection.scalar(sa.text("SELECT version_num FROM alembic_version")) == VERSION
    engine.dispose()


def test_an_earlier_run_directory_is_read_to_the_bit_and_goes_on(tmp_path, make_scenario):
    job = make_job(make_scenario(), "idm", 0.5, "naive", 1, {"budget": 100})
    description = {"format": 1, "jobs": [job]}
    (tmp_path / "run.json").write_bytes(msgspec.json.encode(description))
    first_version(tmp_path / "rollouts.sqlite")
    with RunDirectory.open(tmp_path) as run:
        (chunk,) = run.chunks("naive", "estimate", 0)
        assert (chunk.start, chunk.stop, chunk.errors, chunk.worker_s) == (7, 10, {1: "lost"}, 0.25)
        assert chunk.f.tobytes() == np.array([0.5, np.nan, -0.0]).tobytes()
        run.append("naive", "estimate", 0, type(chunk)(0, 3, chunk.f, chunk.outcomes, chunk.steps, {}, 1.0))
    with RunDirectory.open(tmp_path) as run:
        assert [c.start for c in run.chunks("naive", "estimate", 0)] == [0, 7]


def test_a_migration_that_is_cut_short_leaves_the_record_as_it_was(tmp_path, monkeypatch):
    from alembic import op

    file = tmp_path / "jobs.sqlite"
    first_version(file)
    before = [*sqlite3.connect(file).iterdump()]

    def killed(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(op, "drop_table", killed)
    with pytest.raises(KeyboardInterrupt):
        open_engine(f"sqlite:///{file}")
    assert [*sqlite3.connect(file).iterdump()] == before


def test_a_later_version_is_refused(url):
    engine = open_engine(url)
    with engine.begin() as connection:
        connection.execute(sa.text("UPDATE alembic_version SET version_num = '9999'"))
    engine.dispose()
    with pytest.raises(StoreError, match="has schema version 9999, which is later than this tailroad's"):
        open_engine(url)
