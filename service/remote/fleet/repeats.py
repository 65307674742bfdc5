"""Black boxes, repeated: a share of their chunks is run again, by its own worker and by another one, and compared.

A difference is held against the ego and no worker: it may remember what it did before, answer late, or draw numbers of
its own. It is told as a kept event, from which the job's estimate has its warning.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from service.evaluation.store import Chunk
from service.remote.fleet.audits import chosen
from service.remote.fleet.jobs import JobState
from service.remote.fleet.messages import ChunkKey, Drawn, Explicit
from service.remote.fleet.policy import Policy
from service.remote.fleet.tickets import Ticket
from service.remote.fleet.workers import Held, Workers, WorkerState

SAME, OTHER = "same", "other"  # worker


@dataclass
class Repeat:
    """A chunk to be run once more.

    first: the worker whose answer is in the record; chunk: that answer
    where: by whom it is to be run again: SAME or OTHER
    lease: of who runs it now
    """

    key: ChunkKey
    rows: Drawn | Explicit
    first: str
    chunk: Chunk
    where: str
    lease: int | None = None
    losses: int = 0  # leases that ended without an answer

    def told(self, worker: str, again: Chunk) -> dict[str, Any]:
        """The event of an answer: how many rollouts came to something else, and the first of them."""
        f, f_again = self.chunk.f, again.f
        same_f = (f.view("<u8") == f_again.view("<u8")) | (np.isnan(f) & np.isnan(f_again))
        differs = ~(same_f & (self.chunk.outcomes == again.outcomes))
        body: dict[str, Any] = {
            "phase": self.key.phase,
            "iteration": self.key.iteration,
            "rows": [self.key.start, self.key.stop],
            "where": self.where,
            "workers": [self.first, worker],
            "repeated": int(f.size),
            "differed": int(np.count_nonzero(differs)),
        }
        if differs.any():
            row = int(np.argmax(differs))
            values = [None if np.isnan(v) else float(v) for v in (f[row], f_again[row])]
            body["first"] = {"row": self.key.start + row, "f": values}
        return body


class Repeats:
    """The open repetitions."""

    def __init__(self, policy: Policy, secret: bytes):
        self._policy, self._secret = policy, secret
        self.open: dict[tuple[ChunkKey, str], Repeat] = {}

    def of(self, job: str) -> list[Repeat]:
        return [repeat for (key, _), repeat in self.open.items() if key.job == job]

    def consider(self, job: JobState, ticket: Ticket, workers: Workers) -> None:
        """Have a chunk just recorded run again where it is among the share that is, or the first one of its worker."""
        name = ticket.worker
        if job.submitted.audited or not name or (ticket.key, SAME) in self.open:
            return
        new = name not in job.known and self._policy.audit_share > 0.0
        if not new and not chosen(ticket.key, self._policy.audit_share, self._secret):
            return
        if len(self.of(job.id)) >= self._policy.open_audits:
            return
        job.known.add(name)
        rows = job.rows(ticket.key.start, ticket.key.stop, explicit=False)
        for where in (SAME, OTHER):
            repeat = Repeat(ticket.key, rows, name, ticket.chunk, where)
            if any(self._can(worker, repeat, job) for worker in workers.here.values()):
                self.open[ticket.key, where] = repeat

    def unclaimed(self) -> bool:
        """Whether there is one that nobody runs."""
        return any(repeat.lease is None for repeat in self.open.values())

    def wanted(self, worker: WorkerState, jobs: dict[str, JobState]) -> Repeat | None:
        """One for this worker to run."""
        for repeat in self.open.values():
            job = jobs.get(repeat.key.job)
            free = repeat.lease is None and job is not None and not job.paused
            if free and job is not None and self._can(worker, repeat, job):
                return repeat
        return None

    def _can(self, worker: WorkerState, repeat: Repeat, job: JobState) -> bool:
        fits = worker.can_run(job.submitted.ego) and worker.id not in job.refused
        drawable = not (worker.draws_wrong and isinstance(repeat.rows, Drawn))
        return fits and drawable and (worker.id == repeat.first) == (repeat.where == SAME)

    def holds_back(self, job: JobState, workers: Workers) -> bool:
        """Whether a finished job has to wait for one that is run, or that somebody can run."""
        return any(
            repeat.lease is not None or any(self._can(w, repeat, job) for w in workers.here.values())
            for repeat in self.of(job.id)
        )

    def answered(self, held: Held, chunk: Chunk) -> dict[str, Any] | None:
        """What an answer to a lease has shown; None where the lease is of no repetition."""
        for name, repeat in self.open.items():
            if repeat.lease == held.id:
                del self.open[name]
                return repeat.told(held.worker, chunk)
        return None

    def returned(self, held: Held) -> None:
        """A lease ended without an answer."""
        for name, repeat in self.open.items():
            if repeat.lease == held.id:
                repeat.lease = None
                repeat.losses += 1
                if repeat.losses >= self._policy.losses:
                    del self.open[name]
                return

    def drop_job(self, job: str) -> None:
        self.open = {name: one for name, one in self.open.items() if name[0].job != job}

    def drop_worker(self, worker: str) -> None:
        """Forget what is to be held against the worker's answers, which are void."""
        self.open = {name: one for name, one in self.open.items() if one.first != worker}
