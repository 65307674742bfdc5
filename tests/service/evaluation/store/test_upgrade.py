"""A service's database of the last released version, 0.2.0: what is done is told to the bit, what is open goes on.

released_0_2_0.sql was made by that version's own code: `tailroad serve` with a worker, a job of 60 rollouts that ended,
and one of the cross-entropy method that was paused before the service was killed.
"""

from __future__ import annotations

import sqlite3
from pathlib import Path

import pytest

from service.errors import StoreError
from service.evaluation.store.database import sqlite_url
from service.evaluation.store.jobs import JobStore
from service.evaluation.verify import verify
from service.remote.fleet.statistics import Statistics
from service.remote.fleet.stock import take_stock

RELEASED = Path(__file__).parent / "released_0_2_0.sql"
DONE, PAUSED = "jf8a94e80e040", "j3a8bacfbc98d"
# what 0.2.0 itself said of the job that is done: `tailroad show --json`
P, CI, EVENTS, ROLLOUTS = 0.03333333333333333, (0.004062624642093498, 0.1152810444192517), 2, 60


@pytest.fixture
def released(tmp_path: Path) -> Path:
    file = tmp_path / "fleet.sqlite"
    connection = sqlite3.connect(file)
    connection.executescript(RELEASED.read_text(encoding="utf-8"))
    connection.close()
    return file


def test_a_released_database_is_upgraded_and_tells_the_same_bits_twice(released):
    for _ in range(2):  # the second time it is of this version
        with JobStore(sqlite_url(released), new=False) as store:
            rows = {row.id: row for row in store.jobs()}
            assert {name: row.status for name, row in rows.items()} == {DONE: "done", PAUSED: "paused"}
            assert rows[DONE].label == "done before the upgrade"
            problem, step = Statistics(store).last(DONE)
            found = problem.algorithm.estimate(step.state)
            assert (found.p, found.events, found.rollouts) == (P, EVENTS, ROLLOUTS)
            assert found.ci == pytest.approx(CI, rel=1e-12)
            (batch,) = store.iterations(DONE)
            assert (batch["p"], batch["rollouts"]) == (P, ROLLOUTS)
            checked = verify(DONE, rows[DONE].job, store.chunks.rows(DONE), sample=0, workers=1)
            assert (checked.damage, checked.finished) == ((), True)
            assert (checked.old, checked.rollouts) == (checked.chunks, ROLLOUTS)


def test_an_open_job_of_a_released_database_keeps_its_rollouts_and_is_taken_up(released):
    with JobStore(sqlite_url(released), new=False) as store:
        before = sum(chunk.stop - chunk.start for *_, chunk in store.chunks.all_chunks(PAUSED))
        assert before == 160
        assert [row.id for row in take_stock(store)] == [PAUSED]
        replay = Statistics(store).open(PAUSED)[1]
        assert replay.rollouts == before
        assert replay.stale == ()
        assert replay.step.batch is not None
        store.log.add("this machine", "resume", PAUSED)
        assert store.log.wrong() == []


def test_a_database_of_a_later_version_is_refused_and_left_as_it_is(released):
    with sqlite3.connect(released) as connection:
        connection.execute("UPDATE alembic_version SET version_num = '9999'")
        before = [*connection.iterdump()]
    connection.close()
    with pytest.raises(StoreError, match="schema version 9999, which is later"):
        JobStore(sqlite_url(released), new=False)
    with sqlite3.connect(released) as connection:
        assert [*connection.iterdump()] == before
    connection.close()
