"""What happens to the scheduler, and what it asks for: the two sides of the state machine.

A request is a number for somebody who waits for an answer; the hub knows who.
"""

from dataclasses import dataclass, field
from typing import Any

from service.evaluation.store import Chunk, Origin
from service.evaluation.store.jobs import AuditRow
from service.remote.fleet.batch_step import BatchStep, IterationRecord, Replay
from service.remote.fleet.messages import Answer, Ask, Bye, ChunkKey, Drawn, Explicit, Failed, Hello, Reply
from service.remote.fleet.peers import NOBODY, Peer

# -- events: what has happened -------------------------------------------------------------------------------


@dataclass(frozen=True)
class Submitted:
    """A job of the database, new or from before a restart. Of two jobs the one of higher priority goes first; jobs of
    one priority share the workers by weight.

    audited: the same rollout has the same bits on any worker
    held_bytes: memory that it takes while it is open, at most
    max_failed: share of its rollouts that may fail
    """

    job: str
    ego: str
    priority: int = 0
    weight: float = 1.0
    paused: bool = False
    audited: bool = True
    held_bytes: int = 0
    max_failed: float = 1.0


@dataclass(frozen=True)
class Opened:
    """The job stands where its recorded chunks take it (answer to Open)."""

    job: str
    generation: int
    epoch: int
    replay: Replay


@dataclass(frozen=True)
class Stepped:
    """The algorithm has taken in a whole batch (answer to Step)."""

    job: str
    generation: int
    replay: Replay


@dataclass(frozen=True)
class Broken:
    """The job cannot go on (answer to Open or Step)."""

    job: str
    generation: int
    reason: str


@dataclass(frozen=True)
class Cancelled:
    job: str


@dataclass(frozen=True)
class Paused:
    job: str


@dataclass(frozen=True)
class Resumed:
    job: str


@dataclass(frozen=True)
class Told:
    """Somebody has something to say about a job, which is to be kept."""

    job: str
    kind: str
    body: dict[str, Any]


@dataclass(frozen=True)
class Requested:
    """A worker's message, to which it waits for a reply.

    chunk: of an Answer, checked
    peer: whose connection it is
    """

    request: int
    message: Hello | Ask | Answer | Failed | Bye
    chunk: Chunk | None = None
    peer: Peer = NOBODY


@dataclass(frozen=True)
class Garbled:
    """A worker's message that cannot be read or cannot be true."""

    worker: str
    reason: str
    peer: Peer = NOBODY


@dataclass(frozen=True)
class Settled:
    """What this machine came to for a chunk that workers disagree on (answer to Settle).

    bits: of its own replay, None where it cannot be run here, for this reason
    """

    key: ChunkKey
    bits: bytes | None
    reason: str = ""


@dataclass(frozen=True)
class Gone:
    """A worker's connection is gone."""

    worker: str


@dataclass(frozen=True)
class Recorded:
    """These answers are in the database (answer to Record)."""

    tickets: tuple[int, ...]


@dataclass(frozen=True)
class StoreTrouble:
    """The database does not take anything now; what it was to take is kept until it does."""

    reason: str


@dataclass(frozen=True)
class StoreWell:
    """The database has taken everything."""


@dataclass(frozen=True)
class Voided:
    """A wrong worker's unconfirmed chunks are out of the record of these jobs (answer to Quarantine)."""

    worker: str
    jobs: tuple[str, ...]


@dataclass(frozen=True)
class Tick:
    """Time has passed."""


Event = (
    Submitted | Opened | Stepped | Broken | Cancelled | Paused | Resumed | Told | Requested | Garbled | Gone | Recorded
    | StoreTrouble | StoreWell | Voided | Settled | Tick
)  # fmt: skip

# -- instructions: what is to be done ------------------------------------------------------------------------


@dataclass(frozen=True)
class Open:
    """Replay the job's record from its beginning; answer with Opened or Broken.

    generation: tells answers to this from answers to an earlier one
    """

    job: str
    generation: int


@dataclass(frozen=True)
class Step:
    """Let the algorithm take in the step's batch; answer with Stepped or Broken."""

    job: str
    generation: int
    step: BatchStep


@dataclass(frozen=True)
class Settle:
    """Run a chunk that workers disagree on on this machine; answer with Settled."""

    key: ChunkKey
    rows: Drawn | Explicit
    limit_s: float


@dataclass(frozen=True)
class Record:
    """Put a chunk into the database; answer with Recorded."""

    ticket: int
    job: str
    phase: str
    iteration: int
    chunk: Chunk
    origin: Origin


@dataclass(frozen=True)
class Send:
    """The reply to a request."""

    request: int
    reply: Reply


@dataclass(frozen=True)
class SetStatus:
    """The job's status for all to see: running, paused, done, cancelled, failed or needs-restart."""

    job: str
    status: str
    reason: str = ""


@dataclass(frozen=True)
class Publish:
    """Something about a job that whoever watches it wants to know.

    kept: for later, too
    """

    job: str
    kind: str
    body: dict = field(default_factory=dict)
    kept: bool = True


@dataclass(frozen=True)
class Note:
    """What batches first, first + 1, ... of the job's epoch came to."""

    job: str
    epoch: int
    first: int
    records: tuple[IterationRecord, ...]


@dataclass(frozen=True)
class Confirm:
    """Record that a second worker ran a chunk to the same bits."""

    audit: AuditRow


@dataclass(frozen=True)
class Quarantine:
    """Void what the worker did and nobody confirmed; answer with Voided.

    also: certificate and host that are refused with it
    """

    worker: str
    reason: str
    also: tuple[str, ...] = ()


Instruction = Open | Step | Settle | Record | Send | SetStatus | Publish | Note | Confirm | Quarantine
