"""A record is checked: what is damaged is told, what is sound is counted, a sample is run again to the bit."""

from __future__ import annotations

import sqlite3

import numpy as np
import pytest
from click.testing import CliRunner

from service.errors import StoreError
from service.evaluation.job import make_job
from service.evaluation.pool import in_sumo
from service.evaluation.recorded import Watcher, evaluate_recorded
from service.evaluation.store import Origin, RunDirectory
from service.evaluation.store.jobs import JobStore
from service.evaluation.verify import verify
from service.front.cli.verify import command


@pytest.fixture(scope="module")
def whole(tmp_path_factory, make_scenario):
    """A finished run of the real simulator."""
    scenario = make_scenario({"horizon_s = 10.0": "horizon_s = 1.0"})
    job = make_job(scenario, "idm", 2.0, "naive", 1, {"budget": 700, "batch_size": 350})
    path = tmp_path_factory.mktemp("verify") / "run"
    with RunDirectory.create(path, (job,)) as run:
        evaluate_recorded(run, job, 1, Watcher(), open_world=in_sumo)
    return path, job


@pytest.fixture
def run(whole, tmp_path):
    """A copy of it."""
    path, job = whole
    with RunDirectory.create(tmp_path / "copy", (job,)) as copy, RunDirectory.open(path) as run:
        for phase, iteration, chunk in run.all_chunks(job.id):
            copy.append(job.id, phase, iteration, chunk)
    return tmp_path / "copy"


def check(path, job, sample: int = 0):
    with RunDirectory.open(path, checked=False) as run:
        return verify(job.id, job, run.record.rows(job.id), sample, 1)


def change(path, sql: str, *values) -> None:
    with sqlite3.connect(path / "rollouts.sqlite") as connection:
        connection.execute(sql, values)
    connection.close()


def test_a_sound_record_is_sound_and_its_sample_the_same_to_the_bit(run, whole):
    found = check(run, whole[1], sample=5)
    assert (found.rollouts, found.sound, found.usable, found.finished) == (700, 700, 700, True)
    assert (found.again, found.different, found.old, found.damage) == (5, 0, 0, ())
    result = CliRunner().invoke(command, [str(run), "--sample", "0"])
    assert result.exit_code == 0
    assert "naive: " in result.output
    assert "700 rollouts, sound" in result.output


def test_a_damaged_chunk_is_told_and_the_others_can_be_saved(run, whole):
    with RunDirectory.open(run) as opened:
        last = opened.chunks("naive", "estimate", 0)[-1]
    change(run, "UPDATE chunks SET f = zeroblob(length(f)) WHERE start = ?", last.start)
    found = check(run, whole[1])
    assert len(found.damage) == 1
    assert f"rollouts {last.start} to 700 (phase estimate, iteration 0) is damaged" in found.damage[0]
    assert (found.rollouts, found.sound, found.usable) == (700, last.start, last.start)
    assert not found.finished
    result = CliRunner().invoke(command, [str(run), "--sample", "0"])
    assert isinstance(result.exception, StoreError)
    assert f"{last.start} rollouts can be saved; {700 - last.start} are damaged" in result.output


def test_values_that_were_changed_with_their_checksum_are_found_by_running_them_again(run, whole):
    """As an altered program would leave them; every rollout is in the sample."""
    _, job = whole
    with RunDirectory.open(run) as opened:
        chunk = opened.chunks("naive", "estimate", 0)[0]
    f = chunk.f.copy()
    f[3] = np.nextafter(f[3], np.inf)
    change(run, "DELETE FROM chunks")
    with RunDirectory.open(run, to_go_on=True) as opened:
        opened.append(
            "naive", "estimate", 0, type(chunk)(0, chunk.stop, f, chunk.outcomes, chunk.steps, {}, 1.0)
        )
    found = check(run, job, sample=chunk.stop)
    assert (found.again, found.different) == (chunk.stop, 1)
    assert f"rollout 3 (phase estimate, iteration 0) has f = {float(f[3])!r}" in found.damage[0]


def test_an_edited_seed_is_told(run, whole):
    file = run / "run.json"
    file.write_text(file.read_text().replace('"seed": 1', '"seed": 2'))
    with RunDirectory.open(run, checked=False) as opened:
        (job,) = opened.jobs
        (wrong,) = opened.wrong()
    assert "says seed = 2 of job naive, and its rollouts are of seed = 1" in wrong
    assert job.seed == 2
    found = check(run, job)
    assert all("of other random draws than the job makes here" in line for line in found.damage)
    assert (found.usable, found.sound) == (0, 350)  # the second batch is not reached


def test_rollouts_that_are_recorded_twice_are_told(run, whole):
    with RunDirectory.open(run) as opened:
        chunk = opened.chunks("naive", "estimate", 0)[0]
        half = type(chunk)(1, 3, chunk.f[1:3], chunk.outcomes[1:3], chunk.steps[1:3], {}, 0.1)
        opened.append("naive", "estimate", 0, half)
    assert "rollouts 1 to 3 (phase estimate, iteration 0) are recorded twice" in check(run, whole[1]).damage


def test_the_jobs_of_a_service_are_checked_with_what_is_kept_beside_their_chunks(run, whole, tmp_path):
    job = whole[1]
    with JobStore(f"sqlite:///{tmp_path / 'fleet.sqlite'}") as store, RunDirectory.open(run) as opened:
        for name in ("good", "bad", "short"):
            store.add_job(name, job, 0, 1.0, "", "done")
            chunks = list(opened.all_chunks(job.id))
            for phase, iteration, chunk in chunks[:-1] if name == "short" else chunks:
                store.append([(name, phase, iteration, chunk, Origin("w", 0))])
    with sqlite3.connect(tmp_path / "fleet.sqlite") as connection:
        connection.execute("UPDATE chunks SET worker = 'x' WHERE job = 'bad'")
    connection.close()
    result = CliRunner().invoke(command, ["--store", str(tmp_path), "--sample", "0"])
    assert isinstance(result.exception, StoreError)
    assert "2 jobs are damaged" in str(result.exception)
    assert "the job is done, and its record does not reach its end" in result.output
    assert "good: " in result.output


def test_a_database_that_is_not_there_is_not_made(tmp_path):
    result = CliRunner().invoke(command, ["--store", f"sqlite:///{tmp_path / 'none.sqlite'}"])
    assert isinstance(result.exception, StoreError)
    result = CliRunner().invoke(command, [])
    assert "give a run directory or --store" in str(result.exception)
