"""The rollouts on record as a list: of one phase, one ending or a range of f, in the order of the record or of f."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from service.evaluation.pool import OUTCOME_CODES, OUTCOME_NAMES
from service.evaluation.store.chunk import Chunk


@dataclass(frozen=True)
class Wanted:
    """Which rollouts are listed. None: whatever it is.

    phase: "estimate" or "train"
    outcome: how they ended, a name of OUTCOME_CODES
    low, high: of f, both included, in the unit of the safety measure; failed rollouts have no f
    """

    phase: str | None = None
    outcome: str | None = None
    low: float | None = None
    high: float | None = None

    @property
    def needs_f(self) -> bool:
        """Whether only rollouts with an f fit."""
        return self.low is not None or self.high is not None


@dataclass(frozen=True)
class Listing:
    """A page of a list. All arrays (n,), a place a rollout.

    total: rollouts on record
    found: of them that fit
    phases: names
    iterations, rows: with the phase where a rollout was drawn
    f: NaN where it failed
    outcomes: names
    """

    total: int
    found: int
    phases: tuple[str, ...]
    iterations: np.ndarray
    rows: np.ndarray
    f: np.ndarray
    outcomes: tuple[str, ...]


def listing_of(
    chunks: Iterable[tuple[str, int, Chunk]],
    wanted: Wanted,
    by: str = "record",
    offset: int = 0,
    limit: int = 100,
) -> Listing:
    """Rollouts [offset, offset + limit) of those wanted; by: "record", "f" (lowest first) or "-f"; failed ones last.

    chunks: all of the job, with phase and iteration
    """
    own = list(chunks)
    names = sorted({phase for phase, _, _ in own})
    phase = _joined([np.full(c.f.size, names.index(p), np.int8) for p, _, c in own], np.int8)
    iteration = _joined([np.full(c.f.size, k, np.int64) for _, k, c in own], np.int64)
    row = _joined([np.arange(c.start, c.start + c.f.size) for _, _, c in own], np.int64)
    f = _joined([c.f for _, _, c in own], np.float64)
    code = _joined([c.outcomes for _, _, c in own], np.uint8)
    fits = np.ones(f.size, bool)
    if wanted.phase is not None:
        fits &= phase == (names.index(wanted.phase) if wanted.phase in names else -1)
    if wanted.outcome is not None:
        fits &= code == OUTCOME_CODES[wanted.outcome]
    if wanted.low is not None:
        fits &= f >= wanted.low
    if wanted.high is not None:
        fits &= f <= wanted.high
    found = np.flatnonzero(fits)
    if by != "record":
        key = -f[found] if by == "-f" else f[found]
        found = found[np.argsort(key, kind="stable")]  # NaN last either way
    at = found[offset : offset + limit]
    return Listing(
        total=int(f.size),
        found=int(found.size),
        phases=tuple(names[k] for k in phase[at].tolist()),
        iterations=iteration[at],
        rows=row[at],
        f=f[at],
        outcomes=tuple(OUTCOME_NAMES.get(k, f"code {k}") for k in code[at].tolist()),
    )


def _joined(parts: list[np.ndarray], kind: type[np.generic]) -> np.ndarray:
    return np.concatenate([np.zeros(0, kind), *parts])
