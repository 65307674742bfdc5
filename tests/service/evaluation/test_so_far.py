"""An estimate before its batch is complete: first rows in their order, whoever was done first."""

from __future__ import annotations

import numpy as np
import pytest

import ce
from ce.cross_entropy import CrossEntropyOptions
from ce.naive import Naive, NaiveOptions
from ce.splitting import Splitting, SplittingOptions
from service.evaluation.so_far import begun, state_after
from service.evaluation.store.chunk import Chunk
from service.evaluation.store.draws import row_hashes, rows_digest

BASE = ce.Product([ce.Normal([0.0, 0.0], np.eye(2).tolist())])


def f_of(batch: ce.Batch) -> np.ndarray:
    return 2.0 - batch.x[:, 0]


def chunk_of(batch: ce.Batch, start: int, stop: int, draws: str | None = None) -> Chunk:
    rows = slice(start - batch.start, stop - batch.start)
    n = stop - start
    own = rows_digest(row_hashes(batch.x[rows], batch.noise[rows]))
    return Chunk(
        start, stop, f_of(batch)[rows], np.zeros(n, np.uint8), np.zeros(n, np.int32), {}, 1.0, draws or own
    )


def test_rows_count_as_soon_as_all_before_them_are_answered():
    algorithm = Naive(BASE, 0.0, NaiveOptions(budget=4000))
    state = algorithm.init(1)
    batch = algorithm.propose(state)
    chunks = [("estimate", 0, chunk_of(batch, a, b)) for a, b in ((300, 500), (0, 200), (900, 1000))]
    assert begun(batch, chunks[:1]) is None  # the first rows are still out
    part, f = begun(batch, chunks)
    assert (part.start, part.stop) == (0, 200)
    np.testing.assert_array_equal(f, f_of(batch)[:200])
    chunks.append(("estimate", 0, chunk_of(batch, 200, 300)))
    after = state_after(algorithm, state, *begun(batch, chunks))
    found = algorithm.estimate(after)
    assert found.rollouts == 500
    assert found.p == pytest.approx(np.mean(f_of(batch)[:500] <= 0.0))
    assert found.ci[0] < found.p < found.ci[1]
    assert not found.finished


def test_rows_of_other_draws_and_other_batches_do_not_count():
    algorithm = Naive(BASE, 0.0, NaiveOptions(budget=4000))
    batch = algorithm.propose(algorithm.init(1))
    assert begun(batch, [("estimate", 0, chunk_of(batch, 0, 200, draws="of another seed"))]) is None
    assert begun(batch, [("estimate", 1, chunk_of(batch, 0, 200))]) is None
    assert begun(None, [("estimate", 0, chunk_of(batch, 0, 200))]) is None


def test_the_weights_of_first_rows_are_those_of_their_draws():
    """Of a search, too: its estimate's first rows make the estimate that a whole batch of as many would make."""
    algorithm = ce.algorithm("ce", BASE, 0.0, CrossEntropyOptions(budget=3000, batch_size=1000))
    state = algorithm.init(3)
    while (batch := algorithm.propose(state)).phase != "estimate":
        assert (
            begun(batch, [(batch.phase, batch.iteration, chunk_of(batch, batch.start, batch.stop))]) is None
        )
        state, _ = algorithm.update(state, batch, f_of(batch))
    middle = batch.start + (batch.stop - batch.start) // 2
    part, f = begun(batch, [("estimate", batch.iteration, chunk_of(batch, batch.start, middle))])
    found = algorithm.estimate(state_after(algorithm, state, part, f))
    assert found.estimation_rollouts == middle - batch.start
    density = algorithm.proposal(state)
    weights = np.exp(BASE.log_density(part.x) - density.log_density(part.x))
    assert found.p == pytest.approx(np.mean(weights * (f <= 0.0)), rel=1e-6)


def test_a_running_estimate_of_splitting_holds_finished_replications_alone():
    algorithm = Splitting(BASE, -1.5, SplittingOptions(budget=20_000, replications=10, rel_error=1e-3))
    state, seen = algorithm.init(1), []
    while (batch := algorithm.propose(state)) is not None:
        state, _ = algorithm.update(state, batch, f_of(batch))
        found = algorithm.estimate(state)
        if state.phase != "pilot" and not np.isnan(found.p):
            seen.append(found.p)
            for run in np.unique(found.replication):  # whole ones: their weights sum to one
                own = found.replication == run
                assert np.exp(found.log_weights[own]).sum() == pytest.approx(1.0)
    assert len(set(seen)) == state.replications.group, "it changes once a group, not with every level"
    assert 0.1 < seen[-1] / 2.3e-4 < 10.0
