"""What workers and scheduler say to each other: typed MessagePack, checked when read, limited in size.

A worker asks and the scheduler answers, as Zenoh queries on `tailroad/v1/fleet/WORKER/KIND`:

    hello   Hello  -> Welcome | Refused                  who I am; again whenever the scheduler says it does not know me
    work    Ask    -> Lease | Nothing | Refused          the answer is held back until there is work or hold_s is over
    job     GetJob -> JobSpec | Refused                  once for each job that a worker gets a lease of
    answer  Answer | Failed -> Noted | Refused           sent again until it is noted
    bye     Bye    -> Noted                              the worker leaves, its leases are free

and a liveliness token on `tailroad/v1/fleet/WORKER/alive`.
"""

from typing import Any

import msgspec
import numpy as np

from service.evaluation.job import Job
from service.world.safety.contact import Contact

PREFIX = "tailroad/v1/fleet"
MAX_BYTES = 32 * 2**20  # of a message; larger ones are refused unread
MAX_ROWS = 1000  # of a chunk
MAX_REASON = 2000  # characters


class _Message(msgspec.Struct, frozen=True, forbid_unknown_fields=True, tag_field="kind"):
    pass


class Capabilities(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What a worker can do, and what it is made of (service.remote.fleet.versions)."""

    procs: int
    egos: tuple[str, ...]
    camera: bool
    gpu: bool
    versions: dict[str, str]
    host: str = ""
    pid: int = 0


class Hello(_Message, frozen=True, tag="hello"):
    worker: str
    capabilities: Capabilities


class Ask(_Message, frozen=True, tag="ask"):
    """Slot `slot` of the worker is free; it has `job` open."""

    worker: str
    slot: int
    job: str = ""


class GetJob(_Message, frozen=True, tag="get-job"):
    worker: str
    job: str


class ChunkKey(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Rows [start, stop) of a batch.

    digest: of their x and noise seeds
    """

    job: str
    phase: str
    iteration: int
    start: int
    stop: int
    digest: str


class Answer(_Message, frozen=True, tag="answer"):
    """The rollouts of a chunk: f float64, outcomes uint8, steps int32, little-endian; errors by row of the chunk.

    in_sumo: how many of them SUMO has driven
    contacts: by row of the chunk, of those that ended in one
    """

    worker: str
    lease: int
    chunk: ChunkKey
    f: bytes
    outcomes: bytes
    steps: bytes
    errors: dict[int, str]
    worker_s: float
    in_sumo: int | None = None
    contacts: dict[int, Contact] | None = None


class Failed(_Message, frozen=True, tag="failed"):
    """The chunk was not run.

    refused: this worker cannot run the job at all
    explicit: it needs the rows' x, its own draw gives others
    """

    worker: str
    lease: int
    chunk: ChunkKey
    reason: str
    refused: bool = False
    explicit: bool = False


class Bye(_Message, frozen=True, tag="bye"):
    worker: str


class Welcome(_Message, frozen=True, tag="welcome"):
    hold_s: float  # how long an Ask may stay unanswered


class Drawn(msgspec.Struct, frozen=True, forbid_unknown_fields=True, tag="drawn"):
    """The worker draws the rows from base.with_parameters(parameters)."""

    seed: int
    parameters: bytes  # float64


class Explicit(msgspec.Struct, frozen=True, forbid_unknown_fields=True, tag="explicit"):
    """The rows themselves: x (n, d) float64 and noise seeds (n,) uint64."""

    x: bytes
    noise_seeds: bytes


class Lease(_Message, frozen=True, tag="lease"):
    """Run this chunk; after limit_s another worker gets it."""

    lease: int
    chunk: ChunkKey
    rows: Drawn | Explicit
    limit_s: float


class Nothing(_Message, frozen=True, tag="nothing"):
    """No work now; ask again."""


class JobSpec(_Message, frozen=True, tag="job"):
    """A job, and digests of its road and drivers as the scheduler has them."""

    job: str
    spec: Job
    digests: dict[str, str]


class Noted(_Message, frozen=True, tag="noted"):
    """The scheduler has taken an answer.

    counted: the answer was the first for its chunk
    """

    counted: bool


class Refused(_Message, frozen=True, tag="refused"):
    """The scheduler has no work for this worker.

    again: later the answer may be another
    unknown: say hello first
    taken: another worker has the name; it may be one that is gone and not missed yet

    Neither again nor unknown: this worker is not wanted.
    """

    reason: str
    again: bool = False
    unknown: bool = False
    taken: bool = False


Request = Hello | Ask | GetJob | Answer | Failed | Bye
Reply = Welcome | Lease | Nothing | JobSpec | Noted | Refused

_encoder = msgspec.msgpack.Encoder()
_request_decoder = msgspec.msgpack.Decoder(Request)
_reply_decoder = msgspec.msgpack.Decoder(Reply)


class BadMessage(Exception):
    """Bytes that are no message."""


def encode(message: Request | Reply) -> bytes:
    return _encoder.encode(message)


def decode_request(data: bytes) -> Request:
    """What a worker said; BadMessage for anything else."""
    return _decode(_request_decoder, data)


def decode_reply(data: bytes) -> Reply:
    """What the scheduler answered; BadMessage for anything else."""
    return _decode(_reply_decoder, data)


def _decode(decoder: msgspec.msgpack.Decoder, data: bytes) -> Any:
    if len(data) > MAX_BYTES:
        raise BadMessage(f"{len(data)} bytes; a message has at most {MAX_BYTES}")
    try:
        return decoder.decode(data)
    except (msgspec.MsgspecError, ValueError, RecursionError) as error:
        raise BadMessage(f"not a message of this version: {error}") from error


def array_of(data: bytes, dtype: str, count: int) -> np.ndarray:
    """The array of `count` numbers in `data`; BadMessage where there are not so many."""
    if len(data) != count * np.dtype(dtype).itemsize:
        raise BadMessage(f"{len(data)} bytes do not hold {count} numbers of type {dtype}")
    return np.frombuffer(data, dtype)
