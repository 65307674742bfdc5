"""The record of a job of paths, read: what it came to, and what brings its events back."""

from dataclasses import dataclass, replace

import numpy as np

import ce
from ce.paths import Driven, PathEstimate
from service.evaluation.endings import NO_CONTACT, NOT_RECORDED, Told, side_code
from service.evaluation.job import Problem
from service.evaluation.path_job import EndOfPaths, algorithm_of, carry_on
from service.evaluation.path_store import KeptBatch, PathSource, kept_batch
from service.evaluation.pool import OUTCOME_CODES
from service.world.safety.contact import Contact
from service.world.safety.contact_numbers import SIDES, contact_from
from service.world.scenario.noise import Noise

ESTIMATE = "estimate"


@dataclass(frozen=True)
class PathsRead:
    """What the record of a job of paths says.

    estimate: of f <= its gamma, from the batches that are complete
    records: of the pilot's rounds, then of the batches
    events: draw, noise and f of each path with f <= gamma, by (phase, batch, number among the paths of the batch)
    contacts: of those that ended in one and have it on record, by the same
    told: how all paths of the estimate ended
    """

    estimate: PathEstimate
    records: list[ce.TrainingRecord | ce.EstimationRecord]
    events: dict[tuple[str, int, int], tuple[np.ndarray, Noise, float]]
    contacts: dict[tuple[str, int, int], Contact]
    told: Told


def read_paths(store: PathSource, problem: Problem, gamma: float) -> PathsRead:
    """Read a job's record.

    gamma: threshold of the event, the job's or another
    """
    algorithm = algorithm_of(problem, store.artefacts)
    records: list[ce.TrainingRecord | ce.EstimationRecord] = []
    events: dict[tuple[str, int, int], tuple[np.ndarray, Noise, float]] = {}
    contacts: dict[tuple[str, int, int], Contact] = {}

    def see(kept: KeptBatch) -> None:
        batch, driven = kept.batch, kept.driven
        for i in np.flatnonzero(driven.value <= gamma).tolist():
            root = int(driven.root[i])
            x = batch.roots.x[root]
            if np.isnan(x[0]):  # kept are those with an event of the job's own
                row = int(batch.roots.rows[root])
                x = ce.draw(problem.base, problem.stream_seed, ESTIMATE, batch.iteration, row, row + 1)[0][0]
            draw, noise = problem.paths.drawn(x, int(batch.roots.seeds[root]), driven.lineage[i])
            key = ESTIMATE, batch.iteration, i
            events[key] = (draw, noise, float(driven.value[i]))
            if driven.finals.size and (contact := contact_from(driven.finals[i])) is not None:
                contacts[key] = contact

    try:
        state = carry_on(
            store, problem, algorithm, None, observe=lambda after, record: records.append(record), see=see
        )
    except EndOfPaths as ended:
        state = ended.state
    estimate = algorithm.estimate(state)
    if gamma != estimate.gamma:
        estimate = replace(estimate, gamma=gamma)
    return PathsRead(estimate, records, events, contacts, told_of_paths(store, problem.job.id, estimate))


def told_of_paths(store: PathSource, job: str, estimate: PathEstimate) -> Told:
    """How the paths ended that the estimate is made of, in its order."""
    outcomes, sides = [np.zeros(0, np.int64)], [np.zeros(0, np.uint8)]
    for iteration in range(estimate.batches):
        kept = kept_batch(store.artefacts, job, iteration)
        if kept is not None:
            outcomes.append(kept.driven.outcome)
            sides.append(_sides(kept.driven))
    return Told(np.concatenate(outcomes), np.concatenate(sides))


def _sides(driven: Driven) -> np.ndarray:
    """Codes (k,) of the sides that met in each path."""
    codes = np.where(driven.outcome == OUTCOME_CODES["collision"], NOT_RECORDED, NO_CONTACT).astype(np.uint8)
    if driven.finals.size:
        for i in np.flatnonzero(codes == NOT_RECORDED).tolist():
            if (contact := contact_from(driven.finals[i])) is not None:
                codes[i] = side_code(SIDES.index(contact.ego_side), SIDES.index(contact.other_side))
    return codes
