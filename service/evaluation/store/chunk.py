"""A chunk: the finished rollouts of consecutive rows of a batch."""

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import msgspec
import numpy as np

from service.errors import StoreError
from service.world.safety.contact import Contact

FAILED = 255  # outcome code of a rollout that ended in an error


@dataclass(frozen=True)
class Chunk:
    """The finished rollouts of rows [start, stop) of a batch."""

    start: int
    stop: int
    f: np.ndarray  # (n,) float64, NaN = failed
    outcomes: np.ndarray  # (n,) uint8
    steps: np.ndarray  # (n,) int32
    errors: dict[int, str]  # by row, counted from `start`
    worker_s: float
    draws: str = ""  # digest of the rows' x and noise seeds (`draws.py`); "" where it was not written down
    in_sumo: int | None = None  # how many of them SUMO has driven; None where it was not written down
    # of the ego, by row as errors are, of the rollouts that ended in one; None where it was not written down
    contacts: dict[int, Contact] | None = None

    @property
    def driven_in_sumo(self) -> int:
        """How many of the rollouts SUMO has driven: all of them before it was written down."""
        return self.stop - self.start if self.in_sumo is None else self.in_sumo

    def fingerprint(self) -> bytes:
        """Of everything that decides an estimate: two workers that ran the same rows must agree on it to the bit.

        Contacts are left out, so that records of before they were written down keep theirs.
        """
        digest = hashlib.blake2b(digest_size=16)
        digest.update(self.f.astype("<f8").tobytes())
        digest.update(self.outcomes.astype(np.uint8).tobytes())
        digest.update(self.steps.astype("<i4").tobytes())
        digest.update(repr(sorted(self.errors)).encode())
        return digest.digest()


@dataclass(frozen=True)
class Origin:
    """Where a chunk comes from.

    worker: who ran it
    epoch: how often chunks of its job had been voided before
    """

    worker: str = ""
    epoch: int = 0


HERE = Origin()  # run by this process or its own workers, for a run directory


def row_of(job: str, phase: str, iteration: int, chunk: Chunk, origin: Origin = HERE) -> dict[str, Any]:
    """A chunk as a row of the table `chunks`, with the checksum of all that it says."""
    row = {
        "job": job,
        "phase": phase,
        "iteration": iteration,
        "start": chunk.start,
        "epoch": origin.epoch,
        "stop": chunk.stop,
        "f": chunk.f.astype("<f8").tobytes(),
        "outcomes": chunk.outcomes.astype(np.uint8).tobytes(),
        "steps": chunk.steps.astype("<i4").tobytes(),
        "errors": msgspec.json.encode({str(k): v for k, v in chunk.errors.items()}).decode(),
        "worker_s": chunk.worker_s,
        "digest": chunk.draws,
        "worker": origin.worker,
        "in_sumo": chunk.in_sumo,
        "contacts": None
        if chunk.contacts is None
        else msgspec.json.encode({str(k): v for k, v in chunk.contacts.items()}).decode(),
    }
    return row | {"checksum": checksum_of(row)}


def checksum_of(row: Mapping[str, Any]) -> str:
    """Of all columns of a row that say something, but its checksum; so a row of before a column keeps its own."""
    digest = hashlib.blake2b(digest_size=16)
    for name in sorted(row):
        value = row[name]
        data = value if isinstance(value, bytes) else repr(value).encode()
        if name != "checksum" and value is not None:
            digest.update(f"{name} {type(value).__name__} {len(data)} ".encode())
            digest.update(data)
    return digest.hexdigest()


def same_checksum(row: Any) -> bool:
    """Whether a row says what it said when it was written; True for a row of before there were checksums."""
    return not row.checksum or row.checksum == checksum_of(row._asdict())


def chunk_of(row: Any) -> Chunk:
    """A row of the table `chunks` as a chunk; StoreError where the row is damaged."""
    try:
        chunk = _chunk_of(row)
        whole = chunk.f.size == chunk.outcomes.size == chunk.steps.size == chunk.stop - chunk.start
    except (msgspec.MsgspecError, ValueError, TypeError, RecursionError) as error:
        raise _damaged(row) from error
    if not whole or not same_checksum(row):
        raise _damaged(row)
    return chunk


def _damaged(row: Any) -> StoreError:
    return StoreError(
        f"the record of rollouts {row.start} to {row.stop} (phase {row.phase}, iteration {row.iteration}) is damaged; "
        "`tailroad verify` says what else is and what can be saved"
    )


def _chunk_of(row: Any) -> Chunk:
    errors = msgspec.json.decode(row.errors, type=dict[str, str])
    return Chunk(
        row.start,
        row.stop,
        np.frombuffer(row.f, "<f8"),
        np.frombuffer(row.outcomes, np.uint8),
        np.frombuffer(row.steps, "<i4"),
        {int(k): v for k, v in errors.items()},
        row.worker_s,
        row.digest,
        row.in_sumo,
        None
        if row.contacts is None
        else {int(k): v for k, v in msgspec.json.decode(row.contacts, type=dict[str, Contact]).items()},
    )


def failed_chunk(start: int, stop: int, reason: str) -> Chunk:
    """Rows that could not be run."""
    n = stop - start
    return Chunk(
        start,
        stop,
        np.full(n, np.nan),
        np.full(n, FAILED, np.uint8),
        np.zeros(n, np.int32),
        dict.fromkeys(range(n), reason),
        0.0,
        in_sumo=0,
        contacts={},
    )
