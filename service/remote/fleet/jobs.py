"""A job as the scheduler sees it: its open batch, what is out, what is answered."""

from dataclasses import dataclass, field, replace
from enum import Enum

import numpy as np

import ce
from service.evaluation.store import Chunk
from service.remote.fleet.events import Submitted
from service.remote.fleet.messages import ChunkKey, Drawn, Explicit
from service.remote.fleet.pending import Pending, Range
from service.remote.fleet.policy import Policy
from service.remote.fleet.turns import Turn

TIMING_MEMORY = 0.8  # weight of what was known of a rollout's time when another chunk is timed


class Phase(Enum):
    WAITING = "waiting"  # for memory that other jobs hold
    OPENING = "opening"  # its record is being replayed
    WORKING = "working"  # its batch is being run
    STEPPING = "stepping"  # the algorithm takes in a batch
    SETTLING = "settling"  # finished but for open audits


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
    turn: Turn | None = None
    f: np.ndarray = field(default_factory=lambda: np.zeros(0))
    left: int = 0  # rows of the batch that are not in the record
    rollouts: int = 0  # in the record, of all batches
    pending: Pending = field(default_factory=lambda: Pending(np.zeros(0, bool), 0))
    flights: dict[tuple[int, int], Flight] = field(default_factory=dict)
    answers: dict[tuple[int, int], tuple[bytes, str]] = field(
        default_factory=dict
    )  # of the batch: bits, worker
    refused: dict[str, str] = field(default_factory=dict)  # workers that cannot run it, and why
    known: set[str] = field(default_factory=set)  # workers of which a chunk was audited
    waiting: bool = False  # for a worker that decides a dispute, and has said so
    told_at: float = 0.0
    told: int = -1

    @property
    def id(self) -> str:
        return self.submitted.job

    @property
    def _turn(self) -> Turn:
        assert self.turn is not None
        return self.turn

    @property
    def batch(self) -> ce.Batch:
        """The open batch."""
        assert self._turn.batch is not None
        return self._turn.batch

    def begin(self, turn: Turn) -> None:
        """Take up a turn with an open batch."""
        assert turn.batch is not None
        self.phase = Phase.WORKING
        self.turn = turn
        self.f = turn.f.copy()
        self.left = int(np.count_nonzero(~turn.done))
        self.pending = Pending(turn.done, turn.batch.start)
        self.flights = {}
        self.answers = {}

    def end_batch(self) -> Turn:
        """The turn with the batch's f, complete."""
        self.phase = Phase.STEPPING
        self.answers = {}
        return replace(self._turn, f=self.f, done=np.ones(self.f.size, dtype=bool))

    def key(self, chunk: Range) -> ChunkKey:
        batch = self.batch
        digest = self._turn.digest(chunk.start, chunk.stop)
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
        self.rollouts += chunk.f.size
