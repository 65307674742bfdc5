"""A job as the scheduler sees it: its open batch, what is out, what is answered."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from enum import Enum

import numpy as np

import ce
from service.evaluation.failed_share import SHOWN, too_many
from service.evaluation.store import Chunk
from service.remote.fleet.batch_step import BatchStep, failures_told
from service.remote.fleet.events import Submitted
from service.remote.fleet.messages import ChunkKey, Drawn, Explicit
from service.remote.fleet.pending import Pending, Range
from service.remote.fleet.policy import Policy

TIMING_MEMORY = 0.8  # weight of what was known of a rollout's time when another chunk is timed


class Phase(Enum):
    """Where a job that is not over stands.

    phase       what is going on                       left, for what, with which event
    WAITING     other jobs hold the memory it needs    OPENING: it is its turn (Submitted, Resumed, another job's end)
    OPENING     its record is being replayed           WORKING or SETTLING: Opened
    WORKING     its batch is being run                 STEPPING: Recorded, with the batch's last rows
    STEPPING    the algorithm takes in a batch         WORKING or SETTLING: Stepped
    SETTLING    finished but for open audits           over, done: the last of them is closed or cannot be run

    Any phase but WAITING is left for OPENING, a generation later, with Voided. With Cancelled or Broken the job is
    over, cancelled or failed, from any phase.
    """

    WAITING = "waiting"
    OPENING = "opening"
    WORKING = "working"
    STEPPING = "stepping"
    SETTLING = "settling"


# the phases that a phase may be left for; any may be the last one
NEXT_PHASES = {
    Phase.WAITING: {Phase.OPENING},
    Phase.OPENING: {Phase.WORKING, Phase.SETTLING, Phase.OPENING},
    Phase.WORKING: {Phase.STEPPING, Phase.OPENING},
    Phase.STEPPING: {Phase.WORKING, Phase.SETTLING, Phase.OPENING},
    Phase.SETTLING: {Phase.OPENING},
}


@dataclass
class Flight:
    """A chunk that is out; leases: who has it."""

    range: Range
    leases: set[int] = field(default_factory=set)


@dataclass
class JobState:
    """What the scheduler keeps of a job while it is not over."""

    submitted: Submitted
    generation: int = 0  # of (re)openings
    epoch: int = 0  # of the record
    phase: Phase = Phase.OPENING
    paused: bool = False
    spent_s: float = 0.0  # worker time over weight
    row_s: float | None = None  # worker time of a rollout
    step: BatchStep | None = None
    f: np.ndarray = field(default_factory=lambda: np.zeros(0))
    left: int = 0  # rows of the batch that are not in the record
    rollouts: int = 0  # in the record, of all batches
    failed: int = 0  # of them
    first_failures: list[str] = field(default_factory=list)  # what the first of them said
    pending: Pending = field(default_factory=lambda: Pending(np.zeros(0, bool), 0))
    flights: dict[tuple[int, int], Flight] = field(default_factory=dict)
    # of the batch: bits, worker
    answers: dict[tuple[int, int], tuple[bytes, str]] = field(default_factory=dict)
    refused: dict[str, str] = field(default_factory=dict)  # workers that cannot run it, and why
    known: set[str] = field(default_factory=set)  # workers of which a chunk was audited
    reported_at: float = 0.0  # progress, and how far it was
    reported: int = -1

    @property
    def id(self) -> str:
        return self.submitted.job

    @property
    def _present_step(self) -> BatchStep:
        assert self.step is not None
        return self.step

    @property
    def batch(self) -> ce.Batch:
        """The open batch."""
        assert self._present_step.batch is not None
        return self._present_step.batch

    def begin(self, step: BatchStep) -> None:
        """Take up a step with an open batch."""
        assert step.batch is not None
        self.phase = Phase.WORKING
        self.step = step
        self.f = step.f.copy()
        self.left = int(np.count_nonzero(~step.done))
        self.pending = Pending(step.done, step.batch.start)
        self.flights = {}
        self.answers = {}

    def end_batch(self) -> BatchStep:
        """The step with the batch's f, complete."""
        self.phase = Phase.STEPPING
        self.answers = {}
        return replace(self._present_step, f=self.f, done=np.ones(self.f.size, dtype=bool))

    def key(self, chunk: Range) -> ChunkKey:
        batch = self.batch
        digest = self._present_step.digest(chunk.start, chunk.stop)
        return ChunkKey(self.id, batch.phase, batch.iteration, chunk.start, chunk.stop, digest)

    def is_of_batch(self, key: ChunkKey) -> bool:
        """Whether the key is of rows of the open batch, drawn as they are here."""
        if self.phase is not Phase.WORKING:
            return False
        batch = self.batch
        inside = batch.start <= key.start < key.stop <= batch.stop
        return inside and self.key(Range(key.start, key.stop)) == key

    def rows(self, start: int, stop: int, explicit: bool) -> Drawn | Explicit:
        """Rows [start, stop) as a lease tells them."""
        batch = self.batch
        if batch.explicit or explicit:
            part = slice(start - batch.start, stop - batch.start)
            return Explicit(batch.x[part].astype("<f8").tobytes(), batch.noise[part].astype("<u8").tobytes())
        return Drawn(batch.seed, batch.parameters.astype("<f8").tobytes())

    def chunk_rows(self, policy: Policy, slots: int) -> int:
        """Rows of the next chunk: about chunk_s of work, less near the end of the batch so that all end together."""
        if self.row_s is None:
            return policy.first_rows
        usual = policy.chunk_s / self.row_s
        fair = self.pending.rows / (2 * max(slots, 1))
        rows = min(usual, max(fair, policy.least_chunk_s / self.row_s))
        width = 8 * self.batch.x.shape[1]
        return int(min(max(rows, 1), policy.max_rows, max(policy.max_bytes // width, 1)))

    def expected_s(self, rows: int) -> float | None:
        return None if self.row_s is None else rows * self.row_s

    def limit_s(self, policy: Policy, rows: int) -> float:
        if self.row_s is None:
            return policy.first_limit_s
        return max(policy.limit_s, policy.limit_factor * rows * self.row_s)

    def timed(self, chunk: Chunk) -> None:
        """Learn from a chunk how long a rollout takes."""
        measured = chunk.worker_s / (chunk.stop - chunk.start)
        if measured > 0.0:
            old = measured if self.row_s is None else self.row_s
            self.row_s = TIMING_MEMORY * old + (1.0 - TIMING_MEMORY) * measured

    def fill(self, chunk: Chunk) -> None:
        """Count a recorded chunk of the open batch."""
        first = chunk.start - self.batch.start
        self.f[first : first + chunk.f.size] = chunk.f
        self.left -= chunk.f.size
        self.count(
            chunk.f.size,
            int(np.count_nonzero(np.isnan(chunk.f))),
            failures_told(self.batch.phase, self.batch.iteration, chunk),
        )

    def count(self, rollouts: int, failed: int, told: Sequence[str]) -> None:
        """Add rollouts that are in the record.

        told: what the failed ones said
        """
        self.rollouts += rollouts
        self.failed += failed
        self.first_failures += told[: SHOWN - len(self.first_failures)]

    def failed_too_often(self, at_end: bool = False) -> str:
        """Why its failed rollouts end it, "" where they do not."""
        most = self.submitted.max_failed
        return too_many(self.failed, self.rollouts, most, self.first_failures, at_end)
