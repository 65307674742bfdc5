"""x and noise of any recorded rollout, of methods that move chains too, whose draws follow from those before."""

from typing import Any

import numpy as np

import ce
from service.errors import InputError
from service.evaluation.batches import RecordedBatches
from service.evaluation.evaluate import evaluate
from service.evaluation.record import EndOfRecord, JobRecord, no_workers
from service.evaluation.store import ChunkSource
from service.world.scenario.noise import Noise

Found = tuple[np.ndarray, Noise]  # x (d,) and the noise seed


class _Reached(Exception):
    """The batch that holds the rollout; nothing after it is needed."""

    def __init__(self, found: Found) -> None:
        self.found = found


def drawn_again(store: ChunkSource, record: JobRecord, phase: str, iteration: int, row: int) -> Found:
    """The draw of row `row` of the batch stream (phase, iteration); InputError where the record does not reach it.

    What can be drawn from parameters alone, or is at hand as dangerous or failed, comes at once; for the rest the
    search is replayed from the record up to its batch, which takes about as long as reading the record.
    """
    if (phase, iteration) not in record.explicit_batches or (phase, iteration, row) in record.explicit:
        return record.redraw(phase, iteration, row)
    recorded = RecordedBatches(store, record.job, no_workers)

    def run_batch(batch: ce.Batch) -> Any:
        at = row - batch.start
        if (batch.phase, batch.iteration) == (phase, iteration) and 0 <= at < batch.x.shape[0]:
            raise _Reached((batch.x[at].copy(), int(batch.noise[at])))
        return recorded(batch)

    try:
        evaluate(record.problem.algorithm, record.problem.stream_seed, run_batch)
    except _Reached as reached:
        return reached.found
    except EndOfRecord:
        pass
    raise InputError(
        f"the record of the job does not reach rollout {row} of phase {phase}, iteration {iteration}"
    )
