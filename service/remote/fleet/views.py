"""What a fleet says of its jobs, workers and chunks."""

from typing import Any

import msgspec


class JobView(msgspec.Struct, frozen=True):
    """A job and how far it is.

    rollouts: in the record; planned: at most
    leases: chunks that are out now
    """

    id: str
    number: int
    label: str
    scenario: str
    ego: str
    gamma: float
    unit: str  # of gamma, "" where the measure has none
    method: str
    options: dict[str, Any]
    seed: int
    priority: int
    weight: float
    at: str
    status: str  # running, paused, done, cancelled, failed or needs-restart
    reason: str
    rollouts: int | None = None  # None for a job that is over; the estimate has them
    leases: int = 0
    refusals: dict[str, str] = {}  # workers that cannot run it, and why
    measure: str = ""
    noise_mode: str = ""
    disputed: bool = False  # workers disagree on some of its rollouts, and it is not settled yet
    max_failed: float = 1.0  # share of failed rollouts that is tolerated
    note: str = ""
    tags: tuple[str, ...] = ()
    archived: bool = False


class RunningChunk(msgspec.Struct, frozen=True, kw_only=True):
    """A chunk that a worker has now.

    audit: another worker has run it before
    for_s: since it was given
    """

    job: str
    phase: str
    iteration: int
    rows: int
    audit: bool
    for_s: float


class Tally(msgspec.Struct, frozen=True, kw_only=True):
    """What became of chunks since the scheduler began.

    lost: taken back without an answer
    copied: given to a second worker because the first took long
    audited: run again by another worker and judged
    wrong: values that were not the others'
    """

    lost: int
    copied: int
    audited: int
    wrong: int


class WorkerView(msgspec.Struct, frozen=True):
    """A worker that is connected, or (quarantine) was found wrong."""

    id: str
    procs: int = 0
    egos: tuple[str, ...] = ()
    camera: bool = False
    gpu: bool = False
    host: str = ""
    versions: dict[str, str] = {}
    leases: int = 0
    chunks: int = 0
    rollouts: int = 0
    worker_s: float = 0.0
    quarantine: str = ""
    now: tuple[RunningChunk, ...] = ()
