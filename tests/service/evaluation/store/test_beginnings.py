"""A run goes on as it was begun, or is refused by what differs; rollouts that are gone are missed."""

from __future__ import annotations

import sqlite3
import subprocess
import sys

import msgspec
import numpy as np
import pytest
import sqlalchemy as sa

from service.errors import StoreError
from service.evaluation.job import make_job
from service.evaluation.pool import in_sumo
from service.evaluation.recorded import Watcher, evaluate_recorded
from service.evaluation.software import Software, software
from service.evaluation.store import Chunk, Origin, RunDirectory
from service.evaluation.store.beginnings import beginning_row
from service.evaluation.store.chunk import checksum_of
from service.evaluation.store.jobs import JobStore

EDITS = {
    "seed": ('"seed": 1', '"seed": 8', "seed = 8", "seed = 1"),
    "gamma": ('"gamma": 0.5', '"gamma": 0.7', "gamma = 0.7", "gamma = 0.5"),
    "ego": ('"ego": "idm"', '"ego": "lidar"', 'ego = "lidar"', 'ego = "idm"'),
    "options": ('"budget": 100', '"budget": 200', "options.budget = 200", "options.budget = 100"),
    "scenario": ('"horizon_s": 10.0', '"horizon_s": 9.0', "scenario.time.horizon_s = 9.0",
                 "scenario.time.horizon_s = 10.0"),
    "weights": ('"weights_sha256": "', '"weights_sha256": "00', 'weights_sha256 = "00', 'weights_sha256 = "'),
}  # fmt: skip


def chunk(start: int) -> Chunk:
    return Chunk(start, start + 4, np.arange(4.0), np.zeros(4, np.uint8), np.ones(4, np.int32), {}, 0.5)


@pytest.fixture
def run(tmp_path, job):
    with RunDirectory.create(tmp_path / "run", (job,)) as run:
        for start in (0, 4, 8):
            run.append("naive", "estimate", 0, chunk(start))
    return tmp_path / "run"


def other_software(path, job, name: str = "naive") -> None:
    """As if the run had been begun with another numpy."""
    row = beginning_row(name, job)
    earlier = Software(software().code, software().libraries | {"numpy": "1.99"})
    row["software"] = msgspec.json.encode(earlier).decode()
    row["checksum"] = checksum_of(row)
    with sqlite3.connect(path) as connection:
        values = (row["spec"], row["software"], row["at"], row["checksum"], name)
        connection.execute(
            "UPDATE beginnings SET spec = ?, software = ?, at = ?, checksum = ? WHERE job = ?", values
        )
    connection.close()


@pytest.mark.parametrize("field", EDITS)
@pytest.mark.parametrize("to_go_on", [False, True])
def test_a_description_that_was_edited_is_refused_by_the_field(run, field, to_go_on):
    before, after, now, then = EDITS[field]
    file = run / "run.json"
    text = file.read_text()
    assert before in text
    file.write_text(text.replace(before, after, 1))
    with pytest.raises(StoreError) as caught:
        RunDirectory.open(run, to_go_on)
    assert f"says {now}" in str(caught.value)
    assert f"its rollouts are of {then}" in str(caught.value)
    file.write_text(text)
    RunDirectory.open(run, to_go_on).close()


def test_an_edited_seed_is_refused_by_the_commands_that_report_and_go_on(run):
    file = run / "run.json"
    file.write_text(file.read_text().replace('"seed": 1', '"seed": 8'))
    for command in (["report", str(run)], ["estimate", "--resume", str(run)]):
        ended = subprocess.run(
            [sys.executable, "-m", "service.front.cli", *command], capture_output=True, text=True
        )
        assert ended.returncode == 2
        assert "says seed = 8 of job naive" in " ".join(ended.stderr.split())


def test_another_question_is_refused_by_its_first_field(run, make_scenario):
    other = make_job(make_scenario(), "idm", 0.5, "naive", 2, {"budget": 100})
    with pytest.raises(StoreError, match="a run of another question, with seed = 1 and not 2"):
        RunDirectory.open_or_create(run, (other,))


def test_another_version_that_decides_the_same_bits_goes_on(run, job):
    text = (run / "run.json").read_text().replace(f'"tailroad": "{job.tailroad}"', '"tailroad": "9.9.9"')
    (run / "run.json").write_text(text)
    with RunDirectory.open_or_create(run, (job,)) as opened:
        assert opened.jobs[0].tailroad == "9.9.9"


def test_other_software_is_read_and_does_not_go_on(run, job):
    other_software(run / "rollouts.sqlite", job)
    with RunDirectory.open(run) as opened:
        assert len(opened.chunks("naive", "estimate", 0)) == 3
    here = software().libraries["numpy"]
    with pytest.raises(StoreError, match=f"here is numpy {here} instead of 1.99"):
        RunDirectory.open_or_create(run, (job,))


def test_a_damaged_beginning_is_refused(run):
    with sqlite3.connect(run / "rollouts.sqlite") as connection:
        connection.execute("UPDATE beginnings SET at = ''")
    connection.close()
    with pytest.raises(StoreError, match="what job naive was begun with is damaged"):
        RunDirectory.open(run)


@pytest.mark.parametrize("which", ["start = 0", "start = 8", "start >= 0"])
def test_rows_that_were_deleted_are_missed_and_counted_anew_to_go_on(run, caplog, which):
    with sqlite3.connect(run / "rollouts.sqlite") as connection:
        gone = connection.execute(f"DELETE FROM chunks WHERE {which}").rowcount
    connection.close()
    with pytest.raises(StoreError, match=f"has lost {gone} chunks of rollouts of job naive"):
        RunDirectory.open(run)
    with RunDirectory.open(run, to_go_on=True) as opened:
        assert len(opened.chunks("naive", "estimate", 0)) == 3 - gone
    assert "they are run again" in caplog.text
    RunDirectory.open(run).close()


def test_a_run_that_lost_rows_goes_on_to_the_same_bits(tmp_path, make_scenario):
    scenario = make_scenario({"horizon_s = 10.0": "horizon_s = 1.0"})
    job = make_job(scenario, "idm", 2.0, "naive", 1, {"budget": 600, "batch_size": 200})
    path = tmp_path / "run"
    with RunDirectory.create(path, (job,)) as run:
        whole = evaluate_recorded(run, job, 1, Watcher(), open_world=in_sumo)
    with sqlite3.connect(path / "rollouts.sqlite") as connection:
        connection.execute("DELETE FROM chunks WHERE start >= 200")
    connection.close()
    with RunDirectory.open(path, to_go_on=True) as run:
        again = evaluate_recorded(run, job, 1, Watcher(), open_world=in_sumo)
    assert again.f.tobytes() == whole.f.tobytes()


def test_chunks_are_counted_once_however_often_they_are_recorded(url, job):
    with JobStore(url) as store:
        store.add_job("a", job, 0, 1.0, "", "running")
        for _ in range(2):
            store.append([("a", "estimate", 0, chunk(start), Origin("w", 0)) for start in (0, 4)])
        store.append([("a", "estimate", 0, chunk(start), Origin("w", 0)) for start in (4, 8)])
        assert store.chunks.missing() == {}
        with store._engine.begin() as connection:
            connection.execute(sa.text("DELETE FROM chunks WHERE start > 0"))
        assert store.chunks.missing() == {"a": 2}
        store.chunks.count_anew("a")
        assert store.chunks.missing() == {}
