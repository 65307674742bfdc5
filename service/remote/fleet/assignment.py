"""Who gets what: audits first, then the pending rows of the job whose turn it is, then copies of stragglers."""

from service.remote.fleet.jobs import Flight, JobState, Phase
from service.remote.fleet.messages import Ask, Drawn, Explicit, Lease
from service.remote.fleet.state import SchedulerState
from service.remote.fleet.workers import WorkerState


class Assignment:
    """Answers the slots that wait, as far as there is work."""

    def __init__(self, state: SchedulerState):
        self._state = state
        self._policy, self._workers, self._auditing = state.policy, state.workers, state.auditing

    def assign(self, slots: list[tuple[str, int]] | None = None, copies: bool = False) -> None:
        """Give work to these slots, or to all that wait.

        copies: of stragglers, too

        Nothing is given out while the database takes nothing.
        """
        if self._state.trouble:
            return
        late = self._stragglers() if copies and self._workers.waiting else []
        for slot in list(self._workers.waiting) if slots is None else slots:
            if not (late or self._rows_left() or self._auditing.unclaimed()):
                break
            waiting = self._workers.waiting[slot]
            worker = self._workers.here[waiting.ask.worker]
            lease = self._audit(worker, waiting.ask) or self._chunk(worker, waiting.ask, late)
            if lease is not None:
                del self._workers.waiting[slot]
                self._state.send(waiting.request, lease)

    def _rows_left(self) -> bool:
        return any(job.phase is Phase.WORKING and job.pending for job in self._state.jobs.values())

    def _audit(self, worker: WorkerState, ask: Ask) -> Lease | None:
        jobs = self._state.jobs
        audit = self._auditing.wanted(worker, jobs, self._workers) or self._auditing.repeats.wanted(
            worker, jobs
        )
        if audit is None:
            return None
        job = self._state.jobs[audit.key.job]
        rows = audit.key.stop - audit.key.start
        limit, expected = job.limit_s(self._policy, rows), job.expected_s(rows)
        held = self._workers.lease(ask, audit.key, True, self._state.now, limit, expected)
        audit.lease = held.id
        self._charge(job, expected)
        return Lease(held.id, audit.key, audit.rows, limit)

    def _chunk(self, worker: WorkerState, ask: Ask, late: list[tuple[JobState, Flight]]) -> Lease | None:
        job = self._next_job(
            [j for j in self._state.jobs.values() if j.pending and self._able(worker, j)], ask.job
        )
        if job is not None:
            rows = job.pending.take(job.chunk_rows(self._policy, self._workers.slots))
            flight = job.flights[rows.start, rows.stop] = Flight(rows)
            return self._lease(worker, ask, job, flight)
        for i, (job, flight) in enumerate(late):
            if self._able(worker, job):
                del late[i]
                self._workers.tally.copied += 1
                return self._lease(worker, ask, job, flight)
        return None

    def _able(self, worker: WorkerState, job: JobState) -> bool:
        open_to_all = job.phase is Phase.WORKING and not job.paused
        return open_to_all and worker.id not in job.refused and worker.can_run(job.submitted.ego)

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

    def _stragglers(self) -> list[tuple[JobState, Flight]]:
        """Chunks that are out for much longer than they should be and that nobody else has too, the oldest of the
        highest priority first."""
        late: list[tuple[int, float, JobState, Flight]] = []
        for job in self._state.jobs.values():
            for flight in job.flights.values():
                if len(flight.leases) != 1:
                    continue
                held = self._workers.leases[next(iter(flight.leases))]
                expected_s = held.expected_s or self._policy.first_limit_s
                if self._state.now - held.since > max(
                    self._policy.copy_s, self._policy.copy_factor * expected_s
                ):
                    late.append((-job.submitted.priority, held.since, job, flight))
        return [(job, flight) for _, _, job, flight in sorted(late, key=lambda one: one[:2])]

    def _lease(self, worker: WorkerState, ask: Ask, job: JobState, flight: Flight) -> Lease:
        span = flight.range
        key = job.key(span)
        limit, expected = job.limit_s(self._policy, span.rows), job.expected_s(span.rows)
        held = self._workers.lease(ask, key, False, self._state.now, limit, expected)
        flight.leases.add(held.id)
        self._charge(job, expected)
        rows: Drawn | Explicit = job.rows(span.start, span.stop, worker.draws_wrong)
        return Lease(held.id, key, rows, limit)

    def _charge(self, job: JobState, expected_s: float | None) -> None:
        job.spent_s += (expected_s or 0.0) / job.submitted.weight
