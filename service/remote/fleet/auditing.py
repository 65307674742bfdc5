"""Which chunks are audited, by whom, and when a job has to wait for it."""

from service.evaluation.store import Chunk
from service.remote.fleet.audits import Audit, chosen
from service.remote.fleet.jobs import JobState
from service.remote.fleet.messages import ChunkKey, Drawn
from service.remote.fleet.policy import Policy
from service.remote.fleet.repeats import Repeats
from service.remote.fleet.tickets import Ticket
from service.remote.fleet.workers import Held, Workers, WorkerState


class Auditing:
    """The open audits, and what is repeated of black boxes."""

    def __init__(self, policy: Policy, secret: bytes):
        self._policy = policy
        self._secret = secret
        self.open: dict[ChunkKey, Audit] = {}
        self.repeats = Repeats(policy, secret)  # of black boxes, which are not audited

    def of(self, job: str) -> list[Audit]:
        return [audit for audit in self.open.values() if audit.key.job == job]

    def picks(self, job: JobState, ticket: Ticket, workers: Workers) -> bool:
        """Whether a chunk just recorded is to be run again: a share of all, and the first one of every worker."""
        name = ticket.worker
        if not job.submitted.audited:
            return False
        if not name or name in workers.quarantined or ticket.key in self.open:
            return False
        new = name not in job.known and self._policy.audit_share > 0.0
        if not new and not chosen(ticket.key, self._policy.audit_share, self._secret):
            return False
        return len(self.of(job.id)) < self._policy.open_audits

    def begin(self, job: JobState, ticket: Ticket) -> None:
        job.known.add(ticket.worker)
        self._add(job, ticket.key, ticket.worker, ticket.chunk.fingerprint())

    def _add(self, job: JobState, key: ChunkKey, worker: str, bits: bytes) -> None:
        rows = job.rows(key.start, key.stop, explicit=False)
        self.open[key] = Audit(key, rows, worker, job.epoch, {worker: bits})

    def second(
        self, job: JobState, key: ChunkKey, first: str, bits: bytes, worker: str, chunk: Chunk
    ) -> None:
        """A second answer came unasked, of a speculative copy say: as good as an audit."""
        if job.submitted.audited and first and first != worker and key not in self.open:
            self._add(job, key, first, bits)
            self.opinion(key, worker, chunk)

    def opinion(self, key: ChunkKey, worker: str, chunk: Chunk) -> bool:
        """Take an answer as an opinion, where one is wanted from this worker."""
        audit = self.open.get(key)
        if audit is None or worker in audit.opinions:
            return False
        audit.opinions[worker] = chunk.fingerprint()
        audit.lease = None
        return True

    def unclaimed(self) -> bool:
        """Whether there is an audit, or a chunk to be repeated, that nobody runs."""
        waits = any(audit.lease is None and not audit.disputed for audit in self.open.values())
        return waits or self.repeats.unclaimed()

    def wanted(self, worker: WorkerState, jobs: dict[str, JobState], workers: Workers) -> Audit | None:
        """An audit for this worker to run: of what another identity has answered, where another one is here."""
        for audit in self.open.values():
            if audit.lease is not None or audit.disputed:
                continue
            job = jobs.get(audit.key.job)
            if job is None or job.paused or not self._can(worker, audit, job):
                continue
            said = {workers.identity(name) for name in audit.opinions}
            if worker.peer.identity in said and any(
                other.peer.identity not in said and self._can(other, audit, job)
                for other in workers.here.values()
            ):
                continue
            return audit
        return None

    def _can(self, worker: WorkerState, audit: Audit, job: JobState) -> bool:
        fits = worker.can_run(job.submitted.ego) and worker.id not in job.refused
        drawable = not (worker.draws_wrong and isinstance(audit.rows, Drawn))
        return worker.id not in audit.opinions and fits and drawable

    def holds_back(self, job: JobState, workers: Workers) -> bool:
        """Whether a finished job has to wait: for a dispute always, for what else is open where somebody can run it."""
        return self.repeats.holds_back(job, workers) or any(
            audit.disputed
            or audit.lease is not None
            or any(self._can(w, audit, job) for w in workers.here.values())
            for audit in self.of(job.id)
        )

    def disputed(self, job: str) -> bool:
        """Whether workers disagree on a chunk of the job."""
        return any(audit.disputed for audit in self.of(job))

    def returned(self, held: Held) -> None:
        """A lease of an audit, or of a repetition, ended without an answer."""
        self.repeats.returned(held)
        audit = self.open.get(held.key)
        if audit is not None and audit.lease == held.id:
            audit.lease = None
            audit.losses += 1
            if audit.losses >= self._policy.losses and not audit.disputed:
                del self.open[held.key]  # there are others; this one takes its workers with it

    def close(self, key: ChunkKey) -> None:
        del self.open[key]

    def drop_job(self, job: str) -> None:
        self.repeats.drop_job(job)
        self.open = {key: audit for key, audit in self.open.items() if key.job != job}

    def drop_worker(self, name: str) -> None:
        """Forget the worker's opinions, and the audits of what it had answered, which is void."""
        self.repeats.drop_worker(name)
        self.open = {key: audit for key, audit in self.open.items() if audit.counted != name}
        for audit in self.open.values():
            audit.opinions.pop(name, None)
