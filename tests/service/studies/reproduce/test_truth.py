"""Ground truth: what accumulates is what naive Monte Carlo would have found, whatever interrupts it."""

from __future__ import annotations

import msgspec
import numpy as np
import pytest

import ce
from service.errors import StoreError
from service.evaluation.job import Job, make_job
from service.evaluation.store import FAILED, Chunk
from service.studies.reproduce.truth import GroundTruth

GAMMAS = [0.2, 0.5, 0.9]


@pytest.fixture(scope="module")
def job(make_scenario) -> Job:
    return make_job(make_scenario(), "idm", 0.5, "naive", 4, {"budget": 100})


def rolled(n: int = 100) -> np.ndarray:
    f = np.random.default_rng(0).exponential(1.0, n)
    f[7] = np.nan
    f[8] = np.inf
    return f


def chunk(f: np.ndarray, start: int, stop: int) -> Chunk:
    part = f[start:stop]
    codes = np.where(np.isnan(part), FAILED, np.where(part < 0.2, 2, 0)).astype(np.uint8)
    return Chunk(start, stop, part, codes, np.full(part.size, 100, np.int32), {}, 0.5)


def test_chunks_in_any_order_come_to_what_naive_monte_carlo_finds(job, tmp_path):
    f = rolled()
    path = tmp_path / "truth.npz"
    with GroundTruth(path, job) as truth:
        truth.append("naive", "estimate", 0, chunk(f, 60, 100))
        assert truth.rollouts == 0
        truth.append("naive", "estimate", 0, chunk(f, 0, 30))
        assert truth.rollouts == 30
    with GroundTruth(path, job) as truth:  # another process
        truth.append("naive", "estimate", 0, chunk(f, 30, 60))
    again = GroundTruth(path, job)
    assert again.rollouts == 100
    assert (again.ran.worker_s, again.ran.steps) == (1.5, 10_000)
    assert sum(again.ran.outcomes.values()) == 100
    found = again.at(GAMMAS)
    expected = ce.Estimate(0.5, "naive", 0.95, 100, 0, f, None, ce.Product([ce.Beta(2, 2)])).curve(GAMMAS)
    assert found["events"].tolist() == expected.events.tolist()
    np.testing.assert_allclose(found["p"], expected.p, rtol=1e-12)
    np.testing.assert_allclose(found["low"], expected.low, rtol=1e-9)
    assert again.lowest(3).tolist() == np.sort(f[np.isfinite(f)])[:3].tolist()
    assert again.at(GAMMAS, 30)["events"].tolist() == [int((f[:30] <= g).sum()) for g in GAMMAS]


def test_as_a_store_it_answers_what_was_run(job, tmp_path):
    f = rolled()
    truth = GroundTruth(tmp_path / "truth.npz", job)
    truth.append("naive", "estimate", 0, chunk(f, 0, 50))
    truth.append("naive", "estimate", 0, chunk(f, 70, 100))
    parts = truth.chunks("naive", "estimate", 0, 40, 80)
    assert [(p.start, p.stop) for p in parts] == [(40, 50), (70, 80)]
    for part in parts:
        given = f[part.start : part.stop]
        low = given < 1.0
        assert part.f[low].tolist() == given[low].tolist()
        assert np.isinf(part.f[~low & ~np.isnan(given)]).all()
    failed = truth.chunks("naive", "estimate", 0, 0, 10)[0]
    assert np.isnan(failed.f[7])
    assert failed.outcomes[7] == FAILED


def test_other_rollouts_and_damaged_files_are_refused(job, tmp_path):
    path = tmp_path / "truth.npz"
    with GroundTruth(path, job) as truth:
        truth.append("naive", "estimate", 0, chunk(rolled(), 0, 100))
    with pytest.raises(StoreError, match="other drivers"):
        GroundTruth(path, msgspec.structs.replace(job, seed=5))
    path.write_bytes(path.read_bytes()[:200])
    with pytest.raises(StoreError, match="not a readable ground truth"):
        GroundTruth(path, job)


def test_thresholds_above_what_is_kept_are_refused(job, tmp_path):
    truth = GroundTruth(tmp_path / "truth.npz", job)
    truth.append("naive", "estimate", 0, chunk(rolled(), 0, 100))
    with pytest.raises(ValueError, match=r"below 1 s, not 1\.2"):
        truth.at([0.5, 1.2])
