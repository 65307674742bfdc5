"""The run directory: what is written comes back to the bit, once, and what is no run is refused."""

from __future__ import annotations

import numpy as np
import pytest

from service.errors import StoreError
from service.evaluation.store import FAILED, Chunk, RunDirectory


@pytest.fixture
def run(tmp_path, job):
    with RunDirectory.create(tmp_path / "run", (job,)) as directory:
        yield directory


def chunk(start: int, n: int, seed: int = 0) -> Chunk:
    g = np.random.default_rng((seed, start))
    f = g.normal(size=n)
    f[0] = [np.nan, np.inf, 5e-324, -0.0][start % 4]
    errors = {0: "EgoError: täuscht\n'quoted' \x00"} if start % 4 == 0 else {}
    outcomes = g.integers(0, 5, n).astype(np.uint8)
    outcomes[0] = FAILED if errors else outcomes[0]
    return Chunk(start, start + n, f, outcomes, g.integers(0, 4000, n).astype(np.int32), errors, 0.25)


def same(a: Chunk, b: Chunk) -> bool:
    arrays = all(
        np.array_equal(getattr(a, name).view(np.uint8), getattr(b, name).view(np.uint8))
        and getattr(a, name).dtype == getattr(b, name).dtype
        for name in ("f", "outcomes", "steps")
    )
    return arrays and (a.start, a.stop, a.errors, a.worker_s) == (b.start, b.stop, b.errors, b.worker_s)


def test_chunks_come_back_to_the_bit_and_in_order(run):
    written = [chunk(start, n) for start, n in ((30, 10), (0, 1), (1, 5), (17, 13), (6, 11))]
    for one in written:
        run.append("naive", "estimate", 0, one)
    read = run.chunks("naive", "estimate", 0)
    assert [one.start for one in read] == [0, 1, 6, 17, 30]
    assert all(same(a, b) for a, b in zip(read, sorted(written, key=lambda one: one.start), strict=True))


def test_chunks_survive_closing_and_opening(run):
    run.append("naive", "estimate", 0, chunk(0, 8))
    run.close()
    with RunDirectory.open(run.path) as again:
        assert same(again.chunks("naive", "estimate", 0)[0], chunk(0, 8))
        assert again.jobs == run.jobs


def test_the_first_answer_for_a_chunk_is_kept(run):
    run.append("naive", "estimate", 0, chunk(8, 8))
    run.append("naive", "estimate", 0, chunk(8, 8, seed=9))
    run.append("naive", "estimate", 0, chunk(8, 4, seed=9))
    (read,) = run.chunks("naive", "estimate", 0)
    assert same(read, chunk(8, 8))


def test_jobs_phases_and_iterations_are_kept_apart(run):
    keys = [("naive", "estimate", 0), ("ce", "train", 0), ("ce", "train", 1), ("ce", "estimate", 0)]
    for seed, key in enumerate(keys):
        run.append(*key, chunk(1, 3, seed))
    for seed, key in enumerate(keys):
        (read,) = run.chunks(*key)
        assert same(read, chunk(1, 3, seed))
    assert [(phase, iteration) for phase, iteration, _ in run.all_chunks("ce")] == [
        ("estimate", 0),
        ("train", 0),
        ("train", 1),
    ]
    assert run.chunks("ce", "train", 2) == []


def test_two_connections_see_each_other_s_chunks(run):
    with RunDirectory.open(run.path) as reader:
        run.append("naive", "estimate", 0, chunk(0, 4))
        assert len(reader.chunks("naive", "estimate", 0)) == 1


def test_a_second_run_in_the_same_folder_is_refused(run, job):
    with pytest.raises(StoreError, match=r"holds a run already; continue it with --resume"):
        RunDirectory.create(run.path, (job,))


def test_a_folder_that_is_no_run_is_refused(tmp_path):
    with pytest.raises(StoreError, match=r"is not a run directory \(it has no run\.json\)"):
        RunDirectory.open(tmp_path)


@pytest.mark.parametrize(
    "content", [b"", b"{", b"[]", b'{"format": 1}', b'{"format": "1", "jobs": []}', b"\xff\xfe"]
)
def test_a_damaged_description_is_refused(run, content):
    (run.path / "run.json").write_bytes(content)
    with pytest.raises(StoreError, match=r"run\.json cannot be read"):
        RunDirectory.open(run.path)


def test_a_later_format_is_refused(run):
    file = run.path / "run.json"
    file.write_bytes(file.read_bytes().replace(b'"format": 1', b'"format": 2', 1))
    with pytest.raises(StoreError, match="has run format 2; this tailroad reads format 1"):
        RunDirectory.open(run.path)


def test_a_damaged_record_is_refused(run):
    run.append("naive", "estimate", 0, chunk(0, 4))
    run.close()
    for file in run.path.glob("rollouts.sqlite*"):
        file.write_bytes(b"not a database, " * 1000)
    with pytest.raises(StoreError), RunDirectory.open(run.path) as again:
        again.chunks("naive", "estimate", 0)


def test_an_unknown_job_is_refused_with_those_there_are(run, job):
    assert run.job("naive") == job
    with pytest.raises(StoreError, match="has no job 'ce'; it has naive"):
        run.job("ce")
