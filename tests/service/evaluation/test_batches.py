"""Batches answered from the record and run where they are not: interrupted anywhere, the values are the same."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest

import ce
from service.errors import StoreError
from service.evaluation import batches
from service.evaluation.batches import RecordedBatches, _gaps
from service.evaluation.evaluate import evaluate
from service.evaluation.job import Job, make_job
from service.evaluation.pool import Work
from service.evaluation.store import Chunk, RunDirectory
from service.evaluation.store.draws import row_hashes, rows_digest

BASE = ce.Product([ce.Beta(2.0, 2.0), ce.Beta(2.0, 3.0)])


class Interrupted(Exception):
    pass


class Calculator:
    """A pool whose rollouts are a formula; it is interrupted after `until` chunks."""

    def __init__(self, until: int | None = None):
        self.until = until
        self.done: list[tuple[int, int]] = []

    def __call__(self) -> Calculator:
        return self

    def run(self, works: list[Work]) -> Iterator[Chunk]:
        for work in reversed(works):  # in any order
            if self.until is not None and len(self.done) == self.until:
                raise Interrupted
            n = len(work.noise_seeds)
            f = work.x[:, 0] + 0.5 * work.x[:, 1] + (work.noise_seeds % 1000) * 1e-5
            f[work.noise_seeds % 50 == 0] = np.nan
            self.done.append((work.start, work.start + n))
            zeros = np.zeros(n)
            yield Chunk(
                work.start, work.start + n, f, zeros.astype(np.uint8), zeros.astype(np.int32), {}, 0.0
            )


@pytest.fixture(autouse=True)
def small_chunks(monkeypatch):
    monkeypatch.setattr(batches, "MAX_CHUNK", 40)


@pytest.fixture
def job(make_scenario) -> Job:
    return make_job(make_scenario(), "idm", 0.5, "naive", 1, {"budget": 100})


ALGORITHMS = {
    "naive": ce.algorithm("naive", BASE, 0.3, ce.NaiveOptions(budget=500, batch_size=130)),
    "ce": ce.algorithm("ce", BASE, 0.05, ce.CrossEntropyOptions(budget=2000)),
}


def run(algorithm, store: RunDirectory, job: Job, pool: Calculator, seen: list | None = None) -> ce.Estimate:
    watch = (
        (lambda chunk, replayed: seen.append((chunk.start, chunk.stop, replayed)))
        if seen is not None
        else None
    )
    return evaluate(algorithm, 5, RecordedBatches(store, job, pool, *([watch] if watch else [])))


def bits(estimate: ce.Estimate) -> tuple:
    return estimate.p, estimate.std_error, estimate.ci, estimate.rollouts, estimate.f.tobytes()


@pytest.mark.parametrize("method", ALGORITHMS)
def test_interrupted_at_every_chunk_and_resumed_the_estimate_has_the_same_bits(tmp_path, job, method):
    algorithm = ALGORITHMS[method]
    with RunDirectory.create(tmp_path / "whole", (job,)) as store:
        pool = Calculator()
        whole, chunks = run(algorithm, store, job, pool), len(pool.done)
    assert chunks > 8
    with RunDirectory.create(tmp_path / "pieces", (job,)) as store:
        for _ in range(chunks - 1):  # each time, one chunk more is done before the next interruption
            with pytest.raises(Interrupted):
                run(algorithm, store, job, Calculator(until=1))
        run(algorithm, store, job, Calculator(until=1))
        pool = Calculator()
        pieces = run(algorithm, store, job, pool)
    assert bits(pieces) == bits(whole)
    assert pool.done == []


@pytest.mark.parametrize("until", [0, 1, 3, 7, 11])
def test_nothing_that_was_recorded_is_run_again(tmp_path, job, until):
    algorithm = ALGORITHMS["naive"]
    with RunDirectory.create(tmp_path / "run", (job,)) as store:
        first = Calculator(until=until)
        with pytest.raises(Interrupted):
            run(algorithm, store, job, first)
        second, seen = Calculator(), []
        estimate = run(algorithm, store, job, second, seen)
        assert len(first.done) == until
        assert not set(first.done) & set(second.done)
        rows = sorted(first.done + second.done)
        assert [start for start, _ in rows] == [0, *(stop for _, stop in rows[:-1])]
        assert rows[-1][1] == estimate.rollouts == 500
        assert sorted((start, stop) for start, stop, replayed in seen if replayed) == sorted(first.done)
        assert sorted((start, stop) for start, stop, replayed in seen if not replayed) == sorted(second.done)


def test_chunks_of_another_size_are_used_too(tmp_path, job, monkeypatch):
    algorithm = ALGORITHMS["naive"]
    with RunDirectory.create(tmp_path / "whole", (job,)) as store:
        whole = run(algorithm, store, job, Calculator())
    with RunDirectory.create(tmp_path / "pieces", (job,)) as store:
        with pytest.raises(Interrupted):
            run(algorithm, store, job, Calculator(until=5))
        monkeypatch.setattr(batches, "MAX_CHUNK", 17)
        assert bits(run(algorithm, store, job, Calculator())) == bits(whole)


def test_a_finished_run_is_replayed_without_a_pool(tmp_path, job):
    def no_pool():
        pytest.fail("a replay asked for workers")

    algorithm = ALGORITHMS["naive"]
    with RunDirectory.create(tmp_path / "run", (job,)) as store:
        whole = run(algorithm, store, job, Calculator())
        assert bits(run(algorithm, store, job, no_pool)) == bits(whole)


def test_rollouts_that_failed_stay_failed(tmp_path, job):
    with RunDirectory.create(tmp_path / "run", (job,)) as store:
        first = run(ALGORITHMS["naive"], store, job, Calculator())
        again = run(ALGORITHMS["naive"], store, job, Calculator())
    assert first.failed == again.failed > 0


@pytest.mark.parametrize(
    ("done", "size", "expected"),
    [
        ("....", 2, [(0, 2), (2, 4)]),
        (".....", 2, [(0, 2), (2, 4), (4, 5)]),
        ("x.x..x", 9, [(1, 2), (3, 5)]),
        ("xxx", 2, []),
        ("", 2, []),
        ("..x", 1, [(0, 1), (1, 2)]),
    ],
)
def test_gaps_are_covered_in_pieces_of_at_most_the_size(done, size, expected):
    assert _gaps(np.array([c == "x" for c in done], dtype=bool), size) == expected


def test_a_record_of_other_draws_is_refused_and_nothing_is_run(tmp_path, job):
    """As where the seed in run.json was edited."""
    with RunDirectory.create(tmp_path / "run", (job,)) as store:
        run(ALGORITHMS["naive"], store, job, Calculator())
        pool = Calculator()
        with pytest.raises(StoreError, match=r"are of other random draws than its run\.json asks for"):
            evaluate(ALGORITHMS["naive"], 6, RecordedBatches(store, job, pool))
        assert pool.done == []


def test_chunks_say_what_was_drawn(tmp_path, job):
    with RunDirectory.create(tmp_path / "run", (job,)) as store:
        run(ALGORITHMS["naive"], store, job, Calculator())
        x, noise_seeds = ce.draw(BASE, 5, "estimate", 0, 0, 500)
        for _, _, chunk in store.all_chunks(job.id):
            rows = slice(chunk.start, chunk.stop)
            assert chunk.draws == rows_digest(row_hashes(x[rows], noise_seeds[rows]))
