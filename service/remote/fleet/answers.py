"""What a worker answers, checked: anything that no rollout can come to is refused."""

import math

import numpy as np

from service.evaluation.store import FAILED, Chunk
from service.remote.fleet.messages import MAX_REASON, MAX_ROWS, Answer, BadMessage, ChunkKey, array_of

OUTCOMES = np.zeros(256, dtype=bool)
OUTCOMES[[0, 1, 2, 3, 4, FAILED]] = True  # service.evaluation.pool.OUTCOME_CODES, pinned by a test
COLLISION = 2


def answer_of(worker: str, lease: int, key: ChunkKey, chunk: Chunk) -> Answer:
    """A finished chunk as a message."""
    return Answer(
        worker,
        lease,
        key,
        chunk.f.astype("<f8").tobytes(),
        chunk.outcomes.astype(np.uint8).tobytes(),
        chunk.steps.astype("<i4").tobytes(),
        {row: reason[:MAX_REASON] for row, reason in chunk.errors.items()},
        chunk.worker_s,
        chunk.in_sumo,
        chunk.contacts,
    )


def chunk_of(answer: Answer) -> Chunk:
    """The chunk in an answer; BadMessage for one that cannot be true."""
    key = answer.chunk
    n = key.stop - key.start
    if not (key.start >= 0 and 1 <= n <= MAX_ROWS):
        raise BadMessage(f"rows [{key.start}, {key.stop}) are no chunk")
    f = array_of(answer.f, "<f8", n)
    outcomes = array_of(answer.outcomes, "<u1", n)
    steps = array_of(answer.steps, "<i4", n)
    if not OUTCOMES[outcomes].all():
        raise BadMessage(f"outcome {int(outcomes[~OUTCOMES[outcomes]][0])} is not one of a rollout's")
    if (steps < 0).any():
        raise BadMessage("a rollout has a negative number of steps")
    if not np.array_equal(np.isnan(f), outcomes == FAILED):
        raise BadMessage("f must be NaN where the rollout failed, and nowhere else")
    if set(answer.errors) != set(np.flatnonzero(outcomes == FAILED).tolist()):
        raise BadMessage("errors must be given for the rollouts that failed, and for no others")
    if any(len(reason) > MAX_REASON for reason in answer.errors.values()):
        raise BadMessage(f"an error is told in at most {MAX_REASON} characters")
    if not (math.isfinite(answer.worker_s) and answer.worker_s >= 0.0):
        raise BadMessage(f"worker_s is {answer.worker_s}")
    if answer.in_sumo is not None and not 0 <= answer.in_sumo <= n:
        raise BadMessage(f"in_sumo is {answer.in_sumo} of {n} rollouts")
    _check_contacts(answer, outcomes)
    return Chunk(
        key.start, key.stop, f, outcomes, steps, answer.errors, answer.worker_s, in_sumo=answer.in_sumo,
        contacts=answer.contacts,
    )  # fmt: skip


def _check_contacts(answer: Answer, outcomes: np.ndarray) -> None:
    if answer.contacts is None:
        return
    if set(answer.contacts) != set(np.flatnonzero(outcomes == COLLISION).tolist()):
        raise BadMessage(
            "contacts must be given for the rollouts that ended in a collision, and for no others"
        )
    for contact in answer.contacts.values():
        speeds = contact.speed_mps, contact.ahead_mps, contact.left_mps
        if not (contact.other >= 0 and contact.speed_mps >= 0.0 and all(map(math.isfinite, speeds))):
            raise BadMessage(f"no contact is {contact}")
