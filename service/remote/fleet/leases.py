"""What becomes of chunks that are out: answered and recorded, or lost and given out again."""

from service.evaluation.store import Chunk, Origin, failed_chunk
from service.remote.fleet import events as E
from service.remote.fleet.careers import Careers
from service.remote.fleet.jobs import JobState
from service.remote.fleet.messages import ChunkKey, Noted, Nothing
from service.remote.fleet.pending import Range
from service.remote.fleet.tickets import Ticket


class Leases(Careers):
    """The chunks' side of the scheduler."""

    def _leave(self, name: str, lost: int) -> None:
        for lease in sorted(self.workers.here[name].leases):
            self._take_back(lease, lost, f"worker {name} was lost")
        for slot in [s for s in self.workers.waiting if s[0] == name]:
            self._out.append(E.Send(self.workers.waiting.pop(slot).request, Nothing()))
        self.workers.leave(name)
        for job in list(self.jobs.values()):
            self._settle(job)
        self._deal()

    def _take_back(self, lease: int, lost: int, reason: str = "") -> None:
        """End a lease without an answer: its rows are pending again, unless another worker has them too."""
        held = self.workers.release(lease)
        job = self.jobs.get(held.key.job) if held is not None else None
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
        self.workers.tally.lost += lost > 0
        flight.leases.discard(lease)
        if flight.leases:
            return
        rows = flight.range
        again = Range(rows.start, rows.stop, True, rows.losses + lost)
        if again.losses < self.policy.losses:
            del job.flights[rows.start, rows.stop]
            job.pending.give_back(again)
        elif again.rows > 1:  # whatever takes its workers with it is in one half
            del job.flights[rows.start, rows.stop]
            for half in again.halves():
                job.pending.give_back(half)
        else:
            why = f"given up: lost {again.losses} times, the last time because {reason or 'its time was up'}"
            self._record(job, held.key, failed_chunk(rows.start, rows.stop, why), "", None)

    def _record(self, job: JobState, key: ChunkKey, chunk: Chunk, worker: str, request: int | None) -> None:
        span = (key.start, key.stop)
        del job.flights[span]
        job.answers[span] = (chunk.fingerprint(), worker)
        self._last_ticket += 1
        origin = Origin(key.digest, worker, job.epoch)
        self.tickets[self._last_ticket] = Ticket(key, chunk, worker, request, job.generation)
        self._out.append(E.Record(self._last_ticket, job.id, key.phase, key.iteration, chunk, origin))

    def _recorded(self, event: E.Recorded) -> None:
        for number in event.tickets:
            ticket = self.tickets.pop(number)
            if ticket.request is not None:
                self._out.append(E.Send(ticket.request, Noted(True)))
            job = self.jobs.get(ticket.key.job)
            if job is None or ticket.generation != job.generation or not job.is_of_batch(ticket.key):
                continue
            job.fill(ticket.chunk)
            if self._auditing.picks(job, ticket, self.workers):
                self._auditing.begin(job, ticket)
            if job.left == 0:
                self._out.append(E.Step(job.id, job.generation, job.end_batch()))
        self._deal()

    def _store_trouble(self, event: E.StoreTrouble) -> None:
        self.trouble = event.reason

    def _store_well(self, _: E.StoreWell) -> None:
        self.trouble = ""
        self._deal()
