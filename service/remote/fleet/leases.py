"""What becomes of chunks that are out: answered and recorded, or lost and given out again."""

from dataclasses import replace

from service.evaluation.store import Chunk, Origin, failed_chunk
from service.remote.fleet import events as E
from service.remote.fleet.assignment import Assignment
from service.remote.fleet.job_lifecycle import JobLifecycle
from service.remote.fleet.jobs import JobState
from service.remote.fleet.messages import ChunkKey, Noted, Nothing
from service.remote.fleet.pending import Range
from service.remote.fleet.state import SchedulerState
from service.remote.fleet.tickets import Ticket


class Leases:
    """The chunks' side of the scheduler."""

    def __init__(self, state: SchedulerState, assignment: Assignment, lifecycle: JobLifecycle):
        self._state, self._assignment, self._lifecycle = state, assignment, lifecycle
        self._jobs, self._workers = state.jobs, state.workers
        self._auditing, self._policy = state.auditing, state.policy
        self._tickets = state.tickets

    def leave(self, name: str, lost: int) -> None:
        """A worker is here no more: its leases end.

        lost: how often its chunks count as lost by that
        """
        for lease in sorted(self._workers.here[name].leases):
            self.take_back(lease, lost, f"worker {name} was lost")
        for slot in [s for s in self._workers.waiting if s[0] == name]:
            self._state.send(self._workers.waiting.pop(slot).request, Nothing())
        self._workers.leave(name)
        for job in list(self._jobs.values()):
            self._lifecycle.settle(job)
        self._assignment.assign()

    def take_back(self, lease: int, lost: int, reason: str = "") -> None:
        """End a lease without an answer: its rows are pending again, unless another worker has them too."""
        held = self._workers.release(lease)
        job = self._jobs.get(held.key.job) if held is not None else None
        if held is None or job is None:
            return
        if held.expected_s is not None:
            job.spent_s -= held.expected_s / job.submitted.weight
        if held.audit:
            self._auditing.returned(held)
            return
        flight = job.flights.get((held.key.start, held.key.stop))
        if flight is None or lease not in flight.leases:
            return
        self._workers.tally.lost += lost > 0
        flight.leases.discard(lease)
        if flight.leases:
            return
        rows = flight.range
        again = Range(rows.start, rows.stop, True, rows.losses + lost)
        if again.losses < self._policy.losses:
            del job.flights[rows.start, rows.stop]
            job.pending.give_back(again)
        elif again.rows > 1:  # whatever takes its workers with it is in one half
            del job.flights[rows.start, rows.stop]
            for half in again.halves():
                job.pending.give_back(half)
        else:
            why = f"given up: lost {again.losses} times, the last time because {reason or 'its time was up'}"
            self.record(job, held.key, failed_chunk(rows.start, rows.stop, why), "", None)

    def record(self, job: JobState, key: ChunkKey, chunk: Chunk, worker: str, request: int | None) -> None:
        """Have a chunk that is out recorded.

        request: of the worker that waits to hear of it
        """
        span = (key.start, key.stop)
        del job.flights[span]
        job.answers[span] = (chunk.fingerprint(), worker)
        self._state.last_ticket += 1
        chunk, origin = replace(chunk, draws=key.digest), Origin(worker, job.epoch)
        self._tickets[self._state.last_ticket] = Ticket(key, chunk, worker, request, job.generation)
        self._state.do(E.Record(self._state.last_ticket, job.id, key.phase, key.iteration, chunk, origin))

    def recorded(self, event: E.Recorded) -> None:
        """Count what is in the record now; a batch that is complete goes to the algorithm."""
        for number in event.tickets:
            ticket = self._tickets.pop(number)
            if ticket.request is not None:
                self._state.send(ticket.request, Noted(True))
            job = self._jobs.get(ticket.key.job)
            if job is None or ticket.generation != job.generation or not job.is_of_batch(ticket.key):
                continue
            job.fill(ticket.chunk)
            if job.left and self._lifecycle.fails(job):
                continue
            if self._auditing.picks(job, ticket, self._workers):
                self._auditing.begin(job, ticket)
            self._auditing.repeats.consider(job, ticket, self._workers)
            if job.left == 0:
                self._state.do(E.Step(job.id, job.generation, job.end_batch()))
        self._assignment.assign()

    def store_trouble(self, event: E.StoreTrouble) -> None:
        """Assign nothing while the database takes nothing."""
        self._state.trouble = event.reason

    def store_well(self) -> None:
        """Go on."""
        self._state.trouble = ""
        self._assignment.assign()
