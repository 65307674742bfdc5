"""Disks that lie: bits that rot, writes that are torn, pages of before, files that are cut.

What a job is said to have come to is then what it was, or is refused; it is never something else. What its batches came
to on the way may end early.

Each play is told by its number alone, so that it can be played again.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from pathlib import Path

import msgspec
import numpy as np
import pytest

from service.errors import TailroadError
from service.evaluation.job import make_job
from service.evaluation.store.database import sqlite_url
from service.evaluation.store.jobs import JobStore
from service.evaluation.summary import known
from service.remote.fleet.policy import Policy
from service.remote.fleet.statistics import Statistics
from service.world.scenario import Scenario
from tests.service.remote.fleet.light import LightWorker, light_fleet

POLICY = Policy(chunk_s=0.5, first_rows=20, max_rows=40, hold_s=0.3, audit_share=0.0)
KINDS = ("bits", "sector", "page of before", "torn page", "cut")
SECTOR = 512


@dataclass(frozen=True)
class Disk:
    """A database as it was when its job was done, and in the midst of it."""

    folder: Path
    job: str
    whole: bytes
    before: bytes
    told: tuple


def told(folder: Path, name: str) -> tuple:
    """What is said of the job: the question, and what it came to."""
    with JobStore(sqlite_url(folder / "fleet.sqlite"), new=False) as store:
        store.check()
        row = store.job(name)
        if row is None:
            raise TailroadError("there is no such job")
        problem, step = Statistics(store).last(name)
        found = problem.algorithm.estimate(step.state)
        assert row.status in ("done", "running")
        if row.status != "done" or not found.finished or not known(found):
            raise TailroadError("it is said not to be over")
        batches = [msgspec.json.encode(one) for one in store.iterations(name)]
        question = msgspec.json.encode(row.job), msgspec.json.encode(problem.job)
        return question, found.p, found.ci, found.rollouts, found.f.tobytes(), batches


def disk_of(folder: Path, scenario: Scenario) -> Disk:
    """A service's database with a job of 400 rollouts by the formula, in a new folder."""
    file = folder / "fleet.sqlite"
    job = make_job(scenario, "idm", 2.0, "naive", 1, {"budget": 400, "batch_size": 100})
    with light_fleet(folder, POLICY) as fleet:
        name = fleet.fleet.submit(job).id
    before = file.read_bytes()
    with light_fleet(folder, POLICY) as fleet:
        worker = LightWorker(fleet.port, "w")
        fleet.wait_status(name, "done")
        worker.stop()
        fleet.hub.statistics.keep(name)
    assert not (folder / "fleet.sqlite-wal").exists()
    return Disk(folder, name, file.read_bytes(), before, told(folder, name))


@pytest.fixture(scope="module")
def disk(tmp_path_factory, make_scenario) -> Disk:
    return disk_of(tmp_path_factory.mktemp("disk"), make_scenario())


def harmed(disk: Disk, play: int) -> tuple[str, bytes]:
    """What has happened to the disk in a play, and the file."""
    rng = np.random.default_rng(play)
    kind, data = KINDS[play % len(KINDS)], np.frombuffer(disk.whole, np.uint8).copy()
    page = int.from_bytes(disk.whole[16:18], "big")
    at = int(rng.integers(data.size // page)) * page
    if kind == "bits":
        for place in rng.integers(data.size, size=int(rng.integers(1, 9))):
            data[place] ^= 1 << int(rng.integers(8))
    elif kind == "sector":
        first = int(rng.integers(data.size // SECTOR)) * SECTOR
        data[first : first + SECTOR] = 0
    elif kind == "page of before":
        old = np.frombuffer(disk.before[at : at + page], np.uint8)
        data[at : at + old.size] = old
    elif kind == "torn page":
        other = int(rng.integers(data.size // page)) * page
        data[at + page // 2 : at + page] = data[other + page // 2 : other + page]
    else:
        data = data[: int(rng.integers(data.size))]
    return kind, data.tobytes()


def play_all(disk: Disk, tmp_path: Path, plays: range) -> Counter[str]:
    came_to: Counter[str] = Counter()
    for play in plays:
        kind, data = harmed(disk, play)
        for end in ("", "-wal", "-shm"):
            (tmp_path / f"fleet.sqlite{end}").unlink(missing_ok=True)
        (tmp_path / "fleet.sqlite").write_bytes(data)
        try:
            found = told(tmp_path, disk.job)
        except TailroadError:
            came_to[f"{kind}: refused"] += 1
            continue
        except Exception as error:
            raise AssertionError(f"play {play} ({kind}) ends in {type(error).__name__}: {error}") from error
        *answer, batches = found
        *right, all_batches = disk.told  # of those the last may be lost
        same = answer == right and batches == all_batches[: len(batches)]
        assert same, f"play {play} ({kind}) gives something else"
        came_to[f"{kind}: the same"] += 1
    return came_to


def test_a_store_that_was_harmed_tells_what_it_told_or_refuses(disk, tmp_path):
    came_to = play_all(disk, tmp_path, range(50))
    assert sum(came_to.values()) == 50
    assert all(came_to[f"{kind}: refused"] for kind in KINDS), came_to
    assert came_to["bits: the same"] > 0  # where nothing is written


@pytest.mark.long
@pytest.mark.timeout(7200)
def test_stores_harmed_in_ten_thousand_ways(disk, tmp_path):
    came_to = play_all(disk, tmp_path, range(10_000))
    print(dict(sorted(came_to.items())))
    assert sum(came_to.values()) == 10_000
