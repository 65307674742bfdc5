"""What the scheduler decides by: times, limits and shares."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Policy:
    """The scheduler's settings: sizes of chunks, limits of leases, copies and audits.

    chunk_s, least_chunk_s: worker time of a chunk, in general and at the end of a batch
    first_rows, first_limit_s: of a job whose rollouts nobody has timed yet, compilation included
    limit_s, limit_factor: a lease ends after that long, or that multiple of the time expected
    copy_s, copy_factor: a chunk that is out for longer is given to a second worker, where there is nothing else to do
    hold_s: how long a question for work may wait
    losses: of a chunk, before it is split or its rollout given up
    audit_share: of the chunks, run again by a second worker
    open_audits: of a job at most
    sticky_s: how far a worker may stay with its job beyond the job's share, as a change costs it a second
    garbled: messages from a worker before it is quarantined
    progress_s: between two tellings of it
    open_bytes: that open jobs may hold together (service.evaluation.job.held_bytes), beyond which jobs wait
    """

    chunk_s: float = 1.0
    least_chunk_s: float = 0.1
    first_rows: int = 16
    first_limit_s: float = 180.0
    limit_s: float = 30.0
    limit_factor: float = 20.0
    copy_s: float = 2.0
    copy_factor: float = 3.0
    hold_s: float = 5.0
    losses: int = 3
    audit_share: float = 0.02
    open_audits: int = 32
    sticky_s: float = 5.0
    garbled: int = 3
    progress_s: float = 1.0
    max_workers: int = 4096
    max_rows: int = 500
    max_bytes: int = 8 * 2**20  # of a chunk's x
    open_bytes: int = 4_000_000_000


STANDARD = Policy()
