"""How rollouts ended, beside the estimate: each ending's own probability by the same weights; which sides met."""

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

import ce
from ce.replicated import ReplicatedEstimate
from service.evaluation.pool import OUTCOME_CODES, OUTCOME_NAMES
from service.evaluation.store import FAILED, Chunk
from service.evaluation.summary import ContactKind, Ending
from service.world.safety.contact import Side
from service.world.safety.contact_numbers import SIDES

UNKNOWN = 254  # code of a value that no recorded rollout has
NOT_RECORDED = 253  # of a contact whose sides were not written down
NO_CONTACT = 252  # of a rollout without one; contacts have the codes of `side_code`
Chunks = Sequence[tuple[str, int, Chunk]]  # with phase and iteration


@dataclass(frozen=True)
class Told:
    """Of the rollouts that an estimate is made of, in its order: codes (n,) of how they ended, and of the sides that
    met (`side_code`)."""

    outcomes: np.ndarray
    sides: np.ndarray


def endings_of(
    estimate: ce.Estimate, chunks: Iterable[tuple[str, int, Chunk]], told: Told | None = None
) -> tuple[Ending, ...]:
    """The endings that there were, in the order of their codes.

    chunks: all of the job, with phase and iteration
    told: what the estimate is made of, where the chunks do not say it

    An ending is an event like f <= gamma, so that p and its interval come from the same rollouts and weights. Where
    there is none of a kind, there is no line for it.
    """
    if told is None:
        listed = list(chunks)
        told = Told(outcomes_of(estimate, listed), sides_of(estimate, listed))
    codes, found = told.outcomes, []
    for code in np.unique(codes[codes != UNKNOWN]).tolist():
        kinds = _kinds(estimate, told.sides) if code == OUTCOME_CODES["collision"] else ()
        found.append(Ending(OUTCOME_NAMES[code], *_counted(estimate, codes, code), kinds))
    return tuple(found)


def _kinds(estimate: ce.Estimate, codes: np.ndarray) -> tuple[ContactKind, ...]:
    """Contacts by the sides that met, the likeliest first."""
    found = []
    for code in np.unique(codes[(codes != UNKNOWN) & (codes != NO_CONTACT) & (codes != FAILED)]).tolist():
        if code == NOT_RECORDED:
            words: tuple[str, str | None, str | None] = ("sides not recorded", None, None)
        else:
            ego, other = (SIDES[place] for place in divmod(code, len(SIDES)))
            words = (f"the ego's {in_words(ego)}, the other's {in_words(other)}", ego, other)
        found.append(ContactKind(*words, *_counted(estimate, codes, code)))
    return tuple(sorted(found, key=lambda kind: (-(kind.p or 0.0), kind.name)))


def in_words(side: Side) -> str:
    """A side of a vehicle, as it stands in a sentence."""
    return side if side in ("front", "rear") else f"{side} side"


def _counted(
    estimate: ce.Estimate, codes: np.ndarray, code: int
) -> tuple[int, float | None, tuple[float, float]]:
    other = estimate_of(estimate, codes, code)
    return int((codes == code).sum()), _finite(other.p), other.ci


def estimate_of(estimate: ce.Estimate, codes: np.ndarray, code: int) -> ce.Estimate:
    """The estimate of the event that a rollout has this code, from the same rollouts and weights.

    codes: (n,), as of `outcomes_of`
    """
    # f of a failed rollout stays unknown, which the upper end of the interval counts
    values = np.where(codes == code, -1.0, np.where(np.isnan(estimate.f), math.nan, 1.0))
    other = replace(estimate, f=values, gamma=0.0, base_f=np.zeros(0), search_warnings=())
    return replace(other, levels=np.zeros(0)) if isinstance(other, ReplicatedEstimate) else other


def outcomes_of(estimate: ce.Estimate, chunks: Chunks) -> np.ndarray:
    """Outcome codes (n,) of the rollouts that the estimate is made of, in its order; UNKNOWN where none is recorded."""
    return _looked_up(estimate, chunks, lambda chunk: chunk.outcomes)


def sides_of(estimate: ce.Estimate, chunks: Chunks) -> np.ndarray:
    """Codes (n,) of the sides that met in the same rollouts, as of `side_code`; UNKNOWN where none is recorded."""
    return _looked_up(estimate, chunks, sides_in)


def side_code(ego_side: int, other_side: int) -> int:
    """The code of a contact, by the places of its sides in `contact_numbers.SIDES`."""
    return len(SIDES) * ego_side + other_side


def sides_in(chunk: Chunk) -> np.ndarray:
    """Codes (n,) of the sides that met in a chunk's rollouts."""
    touched = chunk.outcomes == OUTCOME_CODES["collision"]
    codes = np.where(touched, NOT_RECORDED, NO_CONTACT).astype(np.uint8)
    for row, contact in (chunk.contacts or {}).items():
        codes[row] = side_code(SIDES.index(contact.ego_side), SIDES.index(contact.other_side))
    return codes


def _looked_up(estimate: ce.Estimate, chunks: Chunks, codes_in: Callable[[Chunk], np.ndarray]) -> np.ndarray:
    """codes_in: codes (rows,) uint8 of a chunk's rollouts."""
    drawn = _drawn(estimate, chunks, codes_in)
    return _by_value(estimate, chunks, codes_in) if drawn is None else drawn


def _drawn(
    estimate: ce.Estimate, chunks: Chunks, codes_in: Callable[[Chunk], np.ndarray]
) -> np.ndarray | None:
    """Of fresh draws, which stand in the record in the estimate's order, those before a first look left out."""
    last = max((iteration for phase, iteration, _ in chunks if phase == "estimate"), default=None)
    own = sorted(
        (chunk for phase, iteration, chunk in chunks if phase == "estimate" and iteration == last),
        key=lambda chunk: chunk.start,
    )
    f = np.concatenate([np.zeros(0), *(chunk.f for chunk in own)])
    codes = np.concatenate([np.zeros(0, np.uint8), *(codes_in(chunk) for chunk in own)])
    for skipped in {0, estimate.training_rollouts}:
        rows = slice(skipped, skipped + estimate.f.size)
        if np.array_equal(f[rows], estimate.f, equal_nan=True):
            return codes[rows]
    return None


def _by_value(estimate: ce.Estimate, chunks: Chunks, codes_in: Callable[[Chunk], np.ndarray]) -> np.ndarray:
    """Of chains, whose states are known by f.

    States at infinity are fresh draws from P0, which f does not tell apart: each kind has its share of them.
    """
    f = np.concatenate([np.zeros(0), *(chunk.f for _, _, chunk in chunks)])
    outcomes = np.concatenate([np.zeros(0, np.uint8), *(codes_in(chunk) for _, _, chunk in chunks)])
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
