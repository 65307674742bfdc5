"""How rollouts ended, by the weights of the estimate, whatever method made it."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

import ce
from service.evaluation.endings import UNKNOWN, endings_of, outcomes_of
from service.evaluation.pool import OUTCOME_CODES
from service.evaluation.store import FAILED, Chunk
from service.world.safety.contact import Contact

HORIZON, COLLISION, OFF_ROAD = (OUTCOME_CODES[name] for name in ("horizon", "collision", "off-road"))
BASE = ce.Product([ce.Beta(2, 2)])


def chunk(start: int, f: np.ndarray, codes: np.ndarray) -> Chunk:
    n = f.size
    return Chunk(start, start + n, f, codes.astype(np.uint8), np.full(n, 100, np.int32), {}, 0.1)


def drawn(n: int = 400) -> tuple[np.ndarray, np.ndarray]:
    source = np.random.default_rng(3)
    f = source.normal(1.0, 1.0, n)
    codes = np.where(f <= 0.0, COLLISION, HORIZON)
    codes[::7] = OFF_ROAD
    f[5], codes[5] = np.nan, FAILED
    f[:3] = np.inf
    return f, codes


def estimate_of(f: np.ndarray, log_weights: np.ndarray | None = None, training: int = 0) -> ce.Estimate:
    return ce.Estimate(0.0, "ce", 0.95, f.size + training, training, f, log_weights, BASE)


def test_of_naive_monte_carlo_they_are_shares_with_their_intervals():
    f, codes = drawn()
    chunks = [
        ("estimate", 0, chunk(200, f[200:], codes[200:])),
        ("estimate", 0, chunk(0, f[:200], codes[:200])),
    ]
    found = {e.outcome: e for e in endings_of(estimate_of(f), chunks)}
    assert sum(e.rollouts for e in found.values()) == f.size
    assert set(found) == {"collision", "horizon", "off-road", "error"}
    for name, ending in found.items():
        times = int((codes == OUTCOME_CODES[name]).sum())
        assert (ending.rollouts, ending.p) == (times, pytest.approx(times / f.size))
        assert ending.ci[0] < times / f.size < ending.ci[1]
    assert found["error"].rollouts == 1


def test_weights_count_and_the_searchs_own_rollouts_do_not():
    f, codes = drawn()
    weights = np.random.default_rng(4).exponential(1.0, f.size)
    search = chunk(0, np.full(50, -1.0), np.full(50, COLLISION))
    chunks = [("train", 0, search), ("estimate", 1, chunk(0, f, codes))]
    found = {e.outcome: e for e in endings_of(estimate_of(f, np.log(weights), 50), chunks)}
    assert found["collision"].p == pytest.approx(weights[codes == COLLISION].sum() / f.size)
    assert found["collision"].rollouts == (codes == COLLISION).sum()


def test_contacts_are_told_by_the_sides_that_met_and_what_was_not_recorded_is_told_so():
    f, codes = drawn()
    codes[::7] = HORIZON
    struck = Contact(1, 2.0, -2.0, 0.0, "front", "middle", "rear", "middle", "ego")
    swiped = Contact(2, 1.0, 0.0, -1.0, "left", "front", "right", "front", "other")
    early = {i: swiped if i % 2 else struck for i in range(200) if codes[i] == COLLISION}
    parts = chunk(0, f[:200], codes[:200]), chunk(200, f[200:], codes[200:])
    chunks = [("estimate", 0, replace(parts[0], contacts=early)), ("estimate", 0, parts[1])]
    (collision,) = (e for e in endings_of(estimate_of(f), chunks) if e.outcome == "collision")
    found = {kind.name: kind for kind in collision.contacts}
    times = {
        "the ego's front, the other's rear": sum(one is struck for one in early.values()),
        "the ego's left side, the other's right side": sum(one is swiped for one in early.values()),
        "sides not recorded": int((codes[200:] == COLLISION).sum()),
    }
    assert {name: kind.rollouts for name, kind in found.items()} == times
    assert all(kind.p == pytest.approx(kind.rollouts / f.size) for kind in found.values())
    assert math.fsum(kind.p for kind in found.values()) == pytest.approx(collision.p)
    assert [kind.p for kind in collision.contacts] == sorted((k.p for k in collision.contacts), reverse=True)
    assert all(kind.ci[0] < kind.p < kind.ci[1] for kind in collision.contacts)


def test_a_value_that_nobody_recorded_has_no_ending():
    f, codes = drawn()
    chunks = [("train", 0, chunk(0, f[:100], codes[:100]))]
    found = outcomes_of(estimate_of(f), chunks)
    assert found[:100].tolist() == codes[:100].tolist() or (found[:3] == np.sort(codes[:3])).all()
    assert (found[100:] == UNKNOWN).all()
    assert outcomes_of(estimate_of(f), []).tolist() == [UNKNOWN] * f.size
    assert UNKNOWN not in OUTCOME_CODES.values()


def recorded(method: str, **options: object) -> tuple[ce.Estimate, list[tuple[str, int, Chunk]]]:
    """An estimate of P(f <= 0) for f = 2 - z in two dimensions, and its rollouts as chunks; below 0 they collide."""
    base = ce.Product([ce.Normal(np.zeros(2), np.eye(2))])
    algorithm = ce.algorithm(method, base, 0.0, ce.OPTIONS[method](**options))
    state, chunks = algorithm.init(5), []
    while (batch := algorithm.propose(state)) is not None:
        f = 2.0 - batch.x[:, 0]
        f[batch.x[:, 0] < -1.0] = np.inf
        codes = np.where(f <= 0.0, COLLISION, np.where(batch.x[:, 1] > 1.0, OFF_ROAD, HORIZON))
        chunks.append((batch.phase, batch.iteration, chunk(batch.start, f, codes)))
        state, _ = algorithm.update(state, batch, f)
    return algorithm.estimate(state), chunks


@pytest.mark.parametrize(
    ("method", "options"),
    [
        ("naive", {"budget": 4000}),
        ("naive", {"budget": 20_000, "rel_error": 0.5, "batch_size": 500}),
        ("ce", {"budget": 4000, "iterations": 2, "samples_per_iteration": 500}),
        ("mixture", {"budget": 4000}),
        ("splitting", {"budget": 4000}),
        ("auto", {"budget": 4000}),
    ],
)
def test_the_event_has_its_own_p_as_an_ending_whatever_the_method(method, options):
    """One question asked in two ways, and P(z2 > 1) = 0.159 beside it."""
    estimate, chunks = recorded(method, **options)
    found = {e.outcome: e for e in endings_of(estimate, chunks)}
    assert set(found) == {"collision", "off-road", "horizon"}
    assert found["collision"].p == pytest.approx(estimate.p, rel=1e-12)
    assert found["collision"].rollouts == estimate.events > 0
    if method == "naive":
        assert found["collision"].ci == pytest.approx(estimate.ci)
    aside = 0.1587 * (1.0 - 0.0228)
    low, high = found["off-road"].ci
    assert low - 0.05 < aside < high + 0.05
    assert math.fsum(e.p or 0.0 for e in found.values()) == pytest.approx(1.0, abs=0.2)
