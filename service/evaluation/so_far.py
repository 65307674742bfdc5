"""What an estimate comes to before its batch is complete: the first rows of the batch count as soon as all are there.

Rows count in their own order and never by which of them were done first: a rollout that ends early, as by a collision,
is answered sooner, and whoever counted what is there would count too many of those.
"""

from collections.abc import Iterable
from typing import Any

import msgspec
import numpy as np

import ce
from service.evaluation.store.chunk import Chunk
from service.evaluation.store.draws import row_hashes, rows_digest

ESTIMATE = "estimate"  # batches of which any first rows are a sample of their own


def begun(
    batch: ce.Batch | None, chunks: Iterable[tuple[str, int, Chunk]]
) -> tuple[ce.Batch, np.ndarray] | None:
    """The first rows of an unfinished batch that are all answered, as a batch, and f of each.

    chunks: of the job, with phase and iteration

    None where there are none, or where the batch is one of a search or of chains, which says nothing before its end.
    """
    if batch is None or batch.phase != ESTIMATE:
        return None
    own = [c for phase, iteration, c in chunks if (phase, iteration) == (batch.phase, batch.iteration)]
    own = sorted((c for c in own if batch.start <= c.start and c.stop <= batch.stop), key=lambda c: c.start)
    at, values = batch.start, [np.zeros(0)]
    for chunk in own:
        if chunk.start > at:
            break
        if chunk.stop > at and _same_draws(batch, chunk):
            values.append(chunk.f[at - chunk.start :])
            at = chunk.stop
    if at == batch.start:
        return None
    rows = at - batch.start
    part = msgspec.structs.replace(batch, x=batch.x[:rows], noise=batch.noise[:rows], stop=at)
    return part, np.concatenate(values)


def state_after(algorithm: ce.Algorithm, state: Any, part: ce.Batch, f: np.ndarray) -> Any:
    """The algorithm's state with the first rows of its batch; the state as it was where those would have it go on to
    something else, which is decided by whole batches alone."""
    after, _ = algorithm.update(state, part, f)
    before, now = algorithm.estimate(state), algorithm.estimate(after)
    grown = now.f.size > before.f.size and now.rollouts == before.rollouts + f.size
    return after if grown else state


def _same_draws(batch: ce.Batch, chunk: Chunk) -> bool:
    """Whether the chunk's rows are those of the batch; True where it was not written down."""
    rows = slice(chunk.start - batch.start, chunk.stop - batch.start)
    return not chunk.draws or chunk.draws == rows_digest(row_hashes(batch.x[rows], batch.noise[rows]))
