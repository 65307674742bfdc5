"""How rollouts ended, beside the estimate: each ending's own probability under P0, by the weights of the estimate."""

import math
from collections.abc import Iterable
from dataclasses import replace

import numpy as np

import ce
from ce.replicated import ReplicatedEstimate
from service.evaluation.pool import OUTCOME_NAMES
from service.evaluation.store import FAILED, Chunk
from service.evaluation.summary import Ending

UNKNOWN = 254  # code of a value that no recorded rollout has


def endings_of(
    estimate: ce.Estimate, chunks: Iterable[tuple[str, int, Chunk]], outcomes: np.ndarray | None = None
) -> tuple[Ending, ...]:
    """The endings that there were, in the order of their codes.

    chunks: all of the job, with phase and iteration
    outcomes: codes (n,) of what the estimate is made of, in its order, where the chunks do not say them

    An ending is an event like f <= gamma, so that p and its interval come from the same rollouts and weights. Where
    there is none of a kind, there is no line for it.
    """
    codes = outcomes_of(estimate, list(chunks)) if outcomes is None else outcomes
    found = []
    for code in np.unique(codes[codes != UNKNOWN]).tolist():
        other = estimate_of(estimate, codes, code)
        found.append(Ending(OUTCOME_NAMES[code], int((codes == code).sum()), _finite(other.p), other.ci))
    return tuple(found)


def estimate_of(estimate: ce.Estimate, codes: np.ndarray, code: int) -> ce.Estimate:
    """The estimate of the event that a rollout ends with this code, from the same rollouts and weights; codes: (n,), as
    of `outcomes_of`."""
    # f of a failed rollout stays unknown, which the upper end of the interval counts
    values = np.where(codes == code, -1.0, np.where(np.isnan(estimate.f), math.nan, 1.0))
    other = replace(estimate, f=values, gamma=0.0, base_f=np.zeros(0), search_warnings=())
    return replace(other, levels=np.zeros(0)) if isinstance(other, ReplicatedEstimate) else other


def outcomes_of(estimate: ce.Estimate, chunks: list[tuple[str, int, Chunk]]) -> np.ndarray:
    """Outcome codes (n,) of the rollouts that the estimate is made of, in its order; UNKNOWN where none is recorded."""
    drawn = _drawn(estimate, chunks)
    return _by_value(estimate, chunks) if drawn is None else drawn


def _drawn(estimate: ce.Estimate, chunks: list[tuple[str, int, Chunk]]) -> np.ndarray | None:
    """Of fresh draws, which stand in the record in the estimate's order, those before a first look left out."""
    last = max((iteration for phase, iteration, _ in chunks if phase == "estimate"), default=None)
    own = sorted(
        (chunk for phase, iteration, chunk in chunks if phase == "estimate" and iteration == last),
        key=lambda chunk: chunk.start,
    )
    f = np.concatenate([np.zeros(0), *(chunk.f for chunk in own)])
    codes = np.concatenate([np.zeros(0, np.uint8), *(chunk.outcomes for chunk in own)])
    for skipped in {0, estimate.training_rollouts}:
        rows = slice(skipped, skipped + estimate.f.size)
        if np.array_equal(f[rows], estimate.f, equal_nan=True):
            return codes[rows]
    return None


def _by_value(estimate: ce.Estimate, chunks: list[tuple[str, int, Chunk]]) -> np.ndarray:
    """Of chains, whose states are known by f.

    States at infinity are fresh draws from P0, which f does not tell apart: each kind has its share of them.
    """
    f = np.concatenate([np.zeros(0), *(chunk.f for _, _, chunk in chunks)])
    outcomes = np.concatenate([np.zeros(0, np.uint8), *(chunk.outcomes for _, _, chunk in chunks)])
    codes = np.full(estimate.f.size, UNKNOWN, np.uint8)
    order = np.argsort(f, kind="stable")
    at = np.minimum(np.searchsorted(f[order], estimate.f), max(f.size - 1, 0))
    if f.size:
        known = f[order][at] == estimate.f
        codes[known] = outcomes[order][at][known]
        codes[np.isnan(estimate.f)] = FAILED
        far, seen = np.flatnonzero(np.isposinf(estimate.f)), outcomes[np.isposinf(f)]
        if far.size and seen.size:
            codes[far] = np.sort(seen)[(np.arange(far.size) * seen.size) // far.size]
    return codes


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None
