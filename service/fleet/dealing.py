"""Who gets what: audits first, then the pending rows of the job whose turn it is, then copies of stragglers."""

from service.fleet import events as E
from service.fleet.auditing import Auditing
from service.fleet.jobs import Flight, JobState, Phase
from service.fleet.messages import Ask, Drawn, Explicit, Lease
from service.fleet.policy import Policy
from service.fleet.workers import Workers, WorkerState


class Dealing:
    """Answers the slots that wait, as far as there is work."""

    def __init__(self, policy: Policy, jobs: dict[str, JobState], workers: Workers, auditing: Auditing):
        self._policy = policy
        self._jobs = jobs
        self._workers = workers
        self._auditing = auditing

    def deal(self, now: float, slots: list[tuple[str, int]] | None) -> list[E.Instruction]:
        """Leases for these slots, or for all that wait."""
        out: list[E.Instruction] = []
        for slot in list(self._workers.waiting) if slots is None else slots:
            if not self._any_work():
                break
            waiting = self._workers.waiting[slot]
            worker = self._workers.here[waiting.ask.worker]
            lease = self._audit(now, worker, waiting.ask) or self._chunk(now, worker, waiting.ask)
            if lease is not None:
                del self._workers.waiting[slot]
                out.append(E.Send(waiting.request, lease))
        return out

    def _any_work(self) -> bool:
        if self._auditing.open:
            return True
        return any(job.phase is Phase.WORKING and (job.pending or job.flights) for job in self._jobs.values())

    def _audit(self, now: float, worker: WorkerState, ask: Ask) -> Lease | None:
        audit = self._auditing.wanted(worker, self._jobs)
        if audit is None:
            return None
        job = self._jobs[audit.key.job]
        rows = audit.key.stop - audit.key.start
        limit, expected = job.limit_s(self._policy, rows), job.expected_s(rows)
        held = self._workers.lease(ask, audit.key, True, now, limit, expected)
        audit.lease = held.id
        self._charge(job, expected)
        return Lease(held.id, audit.key, audit.rows, limit)

    def _chunk(self, now: float, worker: WorkerState, ask: Ask) -> Lease | None:
        able = [
            job
            for job in self._jobs.values()
            if job.phase is Phase.WORKING
            and not job.paused
            and worker.id not in job.refused
            and worker.can_run(job.submitted.ego)
        ]
        job = self._next_job([job for job in able if job.pending], ask.job)
        if job is not None:
            rows = job.pending.take(job.chunk_rows(self._policy, self._workers.slots))
            flight = job.flights[rows.start, rows.stop] = Flight(rows)
            return self._lease(now, worker, ask, job, flight)
        for job in sorted(able, key=lambda job: -job.submitted.priority):
            straggler = self._straggler(now, job)
            if straggler is not None:
                return self._lease(now, worker, ask, job, straggler)
        return None

    def _next_job(self, candidates: list[JobState], at_hand: str) -> JobState | None:
        """Of the highest priority the one that has had least for its weight, or the one at hand if that is not far
        ahead."""
        if not candidates:
            return None
        top = max(job.submitted.priority for job in candidates)
        first = [job for job in candidates if job.submitted.priority == top]
        least = min(first, key=lambda job: job.spent_s)
        for job in first:
            if job.id == at_hand and job.spent_s <= least.spent_s + self._policy.sticky_s:
                return job
        return least

    def _straggler(self, now: float, job: JobState) -> Flight | None:
        """The chunk that is out for longest, if that is much longer than it should be and nobody else has it too."""
        late: tuple[float, Flight] | None = None
        for flight in job.flights.values():
            if len(flight.leases) != 1:
                continue
            held = self._workers.leases[next(iter(flight.leases))]
            patience = max(
                self._policy.copy_s,
                self._policy.copy_factor * (held.expected_s or self._policy.first_limit_s),
            )
            if now - held.since > patience and (late is None or held.since < late[0]):
                late = (held.since, flight)
        return late[1] if late is not None else None

    def _lease(self, now: float, worker: WorkerState, ask: Ask, job: JobState, flight: Flight) -> Lease:
        span = flight.range
        key = job.key(span)
        limit, expected = job.limit_s(self._policy, span.rows), job.expected_s(span.rows)
        held = self._workers.lease(ask, key, False, now, limit, expected)
        flight.leases.add(held.id)
        self._charge(job, expected)
        rows: Drawn | Explicit = job.rows(span.start, span.stop, worker.draws_wrong)
        return Lease(held.id, key, rows, limit)

    def _charge(self, job: JobState, expected_s: float | None) -> None:
        job.spent_s += (expected_s or 0.0) / job.submitted.weight
