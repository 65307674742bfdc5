"""What a job of paths keeps beside its chunks, as artefacts: its committor, its state after the pilot, its batches.

    given             the committor that it was given, where it was
    pilot             the algorithm's state when the pilot is over: plan, levels and the committor
    committor         as trained, for later runs
    batch/00007       a batch of the estimate: its roots, and how all their paths ended

The states of the pilot are not kept, as what they learn from takes 100 MB: a pilot that was cut off is driven again, in
seconds and to the same bits.
"""

import io
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Protocol

import numpy as np

import ce
from ce.paths import Driven, PathBatch, Roots
from service.errors import StoreError
from service.evaluation.store import Chunk, ChunkSource
from service.evaluation.store.draws import row_hashes, rows_digest
from service.world.safety.contact_numbers import contact_from
from service.world.sim import step

GIVEN, PILOT, COMMITTOR = "given", "pilot", "committor"
_DRIVEN = ("events", "hits", "steps", "begun", "root", "weight", "value", "lineage", "outcome", "finals")
_LATER = {"finals"}  # not in batches of before it was kept


class Artefacts(Protocol):
    """Where they are kept, by job and name."""

    def keep(self, job: str, name: str, data: bytes) -> None: ...

    def kept(self, job: str, name: str) -> bytes | None: ...

    def names(self, job: str) -> Iterator[str]: ...


class PathSource(ChunkSource, Protocol):
    """The record of a job of paths: its chunks, and what is beside them."""

    @property
    def artefacts(self) -> Artefacts: ...


@dataclass(frozen=True)
class KeptBatch:
    """A batch of the estimate that has been driven; x of its roots is there where one of their paths was an event."""

    batch: PathBatch
    driven: Driven
    worker_s: float


def batch_name(iteration: int) -> str:
    """What a batch of the estimate is kept under."""
    return f"batch/{iteration:05d}"


def keep_batch(artefacts: Artefacts, job: str, gamma: float, kept: KeptBatch) -> None:
    """Keep a driven batch of the estimate."""
    batch, driven = kept.batch, kept.driven
    events = np.unique(driven.root[driven.value <= gamma])
    arrays = {f"driven_{name}": getattr(driven, name) for name in _DRIVEN} | {
        "seeds": batch.roots.seeds,
        "weights": batch.roots.weights,
        "rows": batch.roots.rows,
        "floored": batch.roots.floored,
        "levels": batch.levels,
        "event_roots": events,
        "event_x": batch.roots.x[events],
        "sizes": np.array([batch.starts, batch.roots.x.shape[1]], np.int64),
        "worker_s": np.array(kept.worker_s),
    }
    file = io.BytesIO()
    np.savez_compressed(file, **arrays)
    artefacts.keep(job, batch_name(batch.iteration), file.getvalue())


def kept_batch(artefacts: Artefacts, job: str, iteration: int) -> KeptBatch | None:
    """A batch of the estimate, where it has been driven; x of roots without an event is NaN."""
    data = artefacts.kept(job, batch_name(iteration))
    if data is None:
        return None
    try:
        with np.load(io.BytesIO(data), allow_pickle=False) as stored:
            starts, dim = (int(v) for v in stored["sizes"])
            x = np.full((stored["seeds"].size, dim), np.nan)
            x[stored["event_roots"]] = stored["event_x"]
            roots = Roots(x, stored["seeds"], stored["weights"], stored["rows"], stored["floored"])
            there = [name for name in _DRIVEN if name not in _LATER or f"driven_{name}" in stored]
            driven = Driven(**{name: stored[f"driven_{name}"] for name in there})
            batch = PathBatch("estimate", iteration, roots, starts, stored["levels"], False, None, None)
            return KeptBatch(batch, driven, float(stored["worker_s"]))
    except (OSError, ValueError, KeyError, IndexError, TypeError) as error:
        raise StoreError(f"batch {iteration} of the paths of job {job} cannot be read: {error}") from error


def chunk_of_batch(batch: PathBatch, driven: Driven, worker_s: float, in_sumo: int) -> Chunk:
    """A driven batch as the record of rollouts has it, a row a root: its lowest value, how that path ended, and the
    steps of all its paths."""
    n = batch.roots.size
    f, outcomes = np.full(n, np.inf), np.full(n, step.RUNNING, np.uint8)
    failed = np.isnan(driven.value)
    order = np.lexsort((np.where(failed, np.inf, driven.value), driven.root))
    first = np.unique(driven.root[order], return_index=True)
    lowest = order[first[1]]
    f[first[0]], outcomes[first[0]] = driven.value[lowest], driven.outcome[lowest]
    errors = {int(r): "a path failed" for r in np.unique(driven.root[failed]) if np.isnan(f[r])}
    digest = rows_digest(row_hashes(batch.roots.x, batch.roots.seeds))
    contacts = {
        int(root): contact
        for root, path in zip(first[0].tolist(), lowest.tolist(), strict=True)
        if driven.outcome[path] == step.COLLIDED
        and (contact := contact_from(driven.finals[path])) is not None
    }
    return Chunk(
        0, n, f, outcomes, driven.steps.astype(np.int32), errors, worker_s, digest, in_sumo, contacts
    )


def committor_in(artefacts: Artefacts, job: str) -> bytes | None:
    """The committor that a job came to, or was given."""
    return artefacts.kept(job, COMMITTOR) or artefacts.kept(job, GIVEN)


def committor_of(data: bytes, where: str) -> ce.paths.NetworkCommittor:
    """StoreError where the bytes are no committor."""
    try:
        return ce.paths.loaded(data)
    except ce.StateError as error:
        raise StoreError(f"{where}: {error}") from error
