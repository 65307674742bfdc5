"""The record of a job of paths, read: what it came to, and what brings its events back."""

from dataclasses import dataclass, replace

import numpy as np

import ce
from ce.paths import PathEstimate
from service.evaluation.job import Problem
from service.evaluation.path_job import EndOfPaths, algorithm_of, carry_on
from service.evaluation.path_store import KeptBatch, PathSource, kept_batch
from service.world.scenario.noise import Noise

ESTIMATE = "estimate"


@dataclass(frozen=True)
class PathsRead:
    """What the record of a job of paths says.

    estimate: of f <= its gamma, from the batches that are complete
    records: of the pilot's rounds, then of the batches
    events: draw, noise and f of each path with f <= gamma, by (phase, batch, number among the paths of the batch)
    """

    estimate: PathEstimate
    records: list[ce.TrainingRecord | ce.EstimationRecord]
    events: dict[tuple[str, int, int], tuple[np.ndarray, Noise, float]]


def read_paths(store: PathSource, problem: Problem, gamma: float) -> PathsRead:
    """Read a job's record; gamma: threshold of the event, the job's or another."""
    algorithm = algorithm_of(problem, store.artefacts)
    records: list[ce.TrainingRecord | ce.EstimationRecord] = []
    events: dict[tuple[str, int, int], tuple[np.ndarray, Noise, float]] = {}

    def see(kept: KeptBatch) -> None:
        batch, driven = kept.batch, kept.driven
        for i in np.flatnonzero(driven.value <= gamma).tolist():
            root = int(driven.root[i])
            x = batch.roots.x[root]
            if np.isnan(x[0]):  # kept are those with an event of the job's own
                row = int(batch.roots.rows[root])
                x = ce.draw(problem.base, problem.stream_seed, ESTIMATE, batch.iteration, row, row + 1)[0][0]
            draw, noise = problem.paths.drawn(x, int(batch.roots.seeds[root]), driven.lineage[i])
            events[ESTIMATE, batch.iteration, i] = (draw, noise, float(driven.value[i]))

    try:
        state = carry_on(
            store, problem, algorithm, None, observe=lambda after, record: records.append(record), see=see
        )
    except EndOfPaths as ended:
        state = ended.state
    estimate = algorithm.estimate(state)
    if gamma != estimate.gamma:
        estimate = replace(estimate, gamma=gamma)
    return PathsRead(estimate, records, events)


def outcomes_of_paths(store: PathSource, job: str, estimate: PathEstimate) -> np.ndarray:
    """Outcome codes (n,) of the paths that the estimate is made of, in its order."""
    found = [np.zeros(0, np.int64)]
    for iteration in range(estimate.batches):
        kept = kept_batch(store.artefacts, job, iteration)
        if kept is not None:
            found.append(kept.driven.outcome)
    return np.concatenate(found)
