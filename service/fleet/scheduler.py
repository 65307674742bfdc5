"""The scheduler: a state machine. It is told what happened and answers what is to be done; it does nothing itself.

    instructions = scheduler.handle(now, event)

`now` is any clock's seconds; one that goes back is taken to stand still. The same events give the same instructions.
Every chunk counts once: its rows are either pending, out (a flight), on their way to the record (a ticket) or in the
record, and only the record is counted.
"""

from collections.abc import Callable
from typing import Any

import msgspec

from service.fleet import events as E
from service.fleet.auditing import Auditing
from service.fleet.dealing import Dealing
from service.fleet.jobs import Flight, JobState, Phase
from service.fleet.messages import Answer, Ask, Bye, ChunkKey, Failed, Hello, Noted, Nothing, Refused, Welcome
from service.fleet.pending import Range
from service.fleet.policy import STANDARD, Policy
from service.fleet.tickets import Ticket
from service.fleet.turns import IterationRecord
from service.fleet.workers import Waiting, Workers, WorkerState
from service.store import Chunk, Origin, failed_chunk


class Scheduler:
    """versions: what a worker must be made of (service.fleet.versions); secret: decides which chunks are audited."""

    def __init__(
        self,
        versions: dict[str, str],
        policy: Policy = STANDARD,
        quarantined: dict[str, str] | None = None,
        secret: bytes = b"",
    ):
        self.policy = policy
        self.versions = versions
        self.jobs: dict[str, JobState] = {}
        self.workers = Workers(quarantined or {})
        self.tickets: dict[int, Ticket] = {}
        self.trouble = ""  # why the database takes nothing
        self.now = float("-inf")
        self._out: list[E.Instruction] = []
        self._last_ticket = 0
        self._voiding: set[str] = set()  # wrong workers whose chunks are still in the record
        self._auditing = Auditing(policy, secret)
        self._dealing = Dealing(policy, self.jobs, self.workers, self._auditing)

    def handle(self, now: float, event: E.Event) -> list[E.Instruction]:
        """What is to be done now that this has happened."""
        self.now = max(self.now, now)
        _HANDLERS[type(event)](self, event)
        out, self._out = self._out, []
        return out

    # -- jobs ------------------------------------------------------------------------------------------------

    def _submitted(self, event: E.Submitted) -> None:
        if event.job in self.jobs:
            return
        peers = [j.spent_s for j in self.jobs.values() if j.submitted.priority == event.priority]
        job = JobState(event, paused=event.paused, spent_s=min(peers, default=0.0))
        self.jobs[job.id] = job
        self._open(job)

    def _open(self, job: JobState) -> None:
        """Have the record replayed; whatever is out is taken by its rows when it comes."""
        job.generation += 1
        job.phase = Phase.OPENING
        job.flights = {}
        self._out.append(E.Open(job.id, job.generation))

    def _turned(self, event: E.Opened | E.Stepped) -> None:
        job = self.jobs.get(event.job)
        if job is None or job.generation != event.generation:
            return
        replay = event.replay
        if isinstance(event, E.Opened):
            job.epoch, job.rollouts = event.epoch, 0
        job.rollouts += replay.rollouts
        self._note(job, replay.turn.number - len(replay.records), *replay.records)
        if replay.turn.batch is None:
            job.phase, job.turn = Phase.SETTLING, replay.turn
            self._settle(job)
        else:
            job.begin(replay.turn)
            self._deal()

    def _note(self, job: JobState, first: int, *records: IterationRecord) -> None:
        if records:
            self._out.append(E.Note(job.id, job.epoch, first, records))
            body = {"number": first + len(records) - 1, "record": msgspec.to_builtins(records[-1])}
            self._out.append(E.Tell(job.id, "iteration", body, kept=False))

    def _broken(self, event: E.Broken) -> None:
        job = self.jobs.get(event.job)
        if job is not None and job.generation == event.generation:
            self._close(job, "failed", event.reason)

    def _cancelled(self, event: E.Cancelled) -> None:
        if event.job in self.jobs:
            self._close(self.jobs[event.job], "cancelled")

    def _paused(self, event: E.Paused) -> None:
        job = self.jobs.get(event.job)
        if job is not None and not job.paused:
            job.paused = True
            self._out.append(E.SetStatus(job.id, "paused"))

    def _resumed(self, event: E.Resumed) -> None:
        job = self.jobs.get(event.job)
        if job is not None and job.paused:
            job.paused = False
            self._out.append(E.SetStatus(job.id, "running"))
            self._deal()

    def _close(self, job: JobState, status: str, reason: str = "") -> None:
        del self.jobs[job.id]
        self._auditing.drop_job(job.id)
        self._out.append(E.SetStatus(job.id, status, reason))
        self._deal()

    def _settle(self, job: JobState) -> None:
        """End a job whose algorithm has finished, unless an audit is open that somebody can run."""
        if (
            job.phase is Phase.SETTLING
            and not self._voiding
            and not self._auditing.holds_back(job, self.workers)
        ):
            self._close(job, "done")

    # -- what workers say ------------------------------------------------------------------------------------

    def _said(self, event: E.Said) -> None:
        message = event.message
        name = message.worker
        if name in self.workers.quarantined:
            why = self.workers.quarantined[name]
            self._out.append(E.Send(event.request, Refused(f"worker {name} is in quarantine: {why}")))
        elif isinstance(message, Hello):
            self._hello(event.request, message)
        elif name not in self.workers.here:
            self._out.append(
                E.Send(event.request, Refused(f"worker {name} has not said hello", unknown=True))
            )
        elif isinstance(message, Ask):
            self._ask(event.request, message)
        elif isinstance(message, Answer):
            assert event.chunk is not None
            self._answer(event.request, message, event.chunk)
        elif isinstance(message, Failed):
            self._failed(message)
            self._out.append(E.Send(event.request, Noted(False)))
            self._deal()
        elif isinstance(message, Bye):
            self._out.append(E.Send(event.request, Noted(False)))
            self._leave(name, lost=0)

    def _hello(self, request: int, message: Hello) -> None:
        theirs = message.capabilities.versions
        for what, ours in self.versions.items():
            if theirs.get(what) != ours:
                reason = (
                    f"worker {message.worker} has {what} {theirs.get(what, 'unknown')}, the scheduler {ours}; "
                    "install the same tailroad with the same constraints on both"
                )
                self._out.append(E.Send(request, Refused(reason)))
                return
        if len(self.workers.here) >= self.policy.max_workers and message.worker not in self.workers.here:
            reason = f"there are {self.policy.max_workers} workers already"
            self._out.append(E.Send(request, Refused(reason, again=True)))
            return
        if message.worker in self.workers.here:  # it was started again
            self._leave(message.worker, lost=1)
        self.workers.here[message.worker] = WorkerState(message.worker, message.capabilities, self.now)
        self._out.append(E.Send(request, Welcome(self.policy.hold_s)))

    def _ask(self, request: int, ask: Ask) -> None:
        slot = (ask.worker, ask.slot)
        procs = self.workers.here[ask.worker].capabilities.procs
        if not 0 <= ask.slot < procs:
            reason = f"slot {ask.slot} of worker {ask.worker}, which has {procs}"
            self._out.append(E.Send(request, Refused(reason)))
            return
        for lease in self.workers.of_slot(*slot):  # the slot never got it
            self._take_back(lease, lost=0)
        if slot in self.workers.waiting:
            self._out.append(E.Send(self.workers.waiting.pop(slot).request, Nothing()))
        self.workers.waiting[slot] = Waiting(request, ask, self.now + self.policy.hold_s)
        self._deal([slot])

    def _answer(self, request: int, answer: Answer, chunk: Chunk) -> None:
        key, name = answer.chunk, answer.worker
        job = self.jobs.get(key.job)
        if job is not None and job.phase is Phase.OPENING:
            self._out.append(E.Send(request, Refused(f"job {key.job} is being opened", again=True)))
            return
        held = self.workers.release(answer.lease, name)
        worker = self.workers.here[name]
        worker.chunks += 1
        worker.rollouts += chunk.f.size
        worker.worker_s += chunk.worker_s
        if job is None:
            self._out.append(E.Send(request, Noted(False)))
            return
        if held is not None and held.expected_s is not None:
            job.spent_s += (chunk.worker_s - held.expected_s) / job.submitted.weight
        span = (key.start, key.stop)
        if self._auditing.opinion(key, name, chunk):
            self._judge(job, key)
        elif not job.is_of_batch(key):
            pass
        elif span in job.flights or (claimed := job.pending.claim(*span)) is not None:
            if span not in job.flights:
                assert claimed is not None
                job.flights[span] = Flight(claimed)
            job.timed(chunk)
            self._record(job, key, chunk, name, request)
            return
        elif span in job.answers:
            bits, first = job.answers[span]
            self._auditing.second(job, key, first, bits, name, chunk)
            self._judge(job, key)
        self._out.append(E.Send(request, Noted(False)))
        self._settle(job)

    def _record(self, job: JobState, key: ChunkKey, chunk: Chunk, worker: str, request: int | None) -> None:
        span = (key.start, key.stop)
        del job.flights[span]
        job.answers[span] = (chunk.fingerprint(), worker)
        self._last_ticket += 1
        origin = Origin(key.digest, worker, job.epoch)
        self.tickets[self._last_ticket] = Ticket(key, chunk, worker, request, job.generation)
        self._out.append(E.Record(self._last_ticket, job.id, key.phase, key.iteration, chunk, origin))

    def _failed(self, message: Failed) -> None:
        held = self.workers.leases.get(message.lease)
        if held is None or held.worker != message.worker:
            return
        job = self.jobs.get(held.key.job)
        if message.explicit:
            self.workers.here[message.worker].draws_wrong = True
        elif message.refused and job is not None:
            job.refused[message.worker] = message.reason
            self._out.append(E.Tell(job.id, "refused", {"worker": message.worker, "reason": message.reason}))
        self._take_back(
            message.lease, lost=0 if message.refused or message.explicit else 1, reason=message.reason
        )

    def _garbled(self, event: E.Garbled) -> None:
        worker = self.workers.here.get(event.worker)
        if worker is None:
            return
        worker.garbled += 1
        if worker.garbled >= self.policy.garbled:
            self._quarantine(
                event.worker, f"{worker.garbled} answers that cannot be read, the last one: {event.reason}"
            )

    def _gone(self, event: E.Gone) -> None:
        if event.worker in self.workers.here:
            self._leave(event.worker, lost=1)

    # -- leases and what becomes of them ---------------------------------------------------------------------

    def _leave(self, name: str, lost: int) -> None:
        for lease in sorted(self.workers.here[name].leases):
            self._take_back(lease, lost, f"worker {name} was lost")
        for slot in [s for s in self.workers.waiting if s[0] == name]:
            self._out.append(E.Send(self.workers.waiting.pop(slot).request, Nothing()))
        del self.workers.here[name]
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

    def _deal(self, slots: list[tuple[str, int]] | None = None) -> None:
        if not self.trouble:
            self._out += self._dealing.deal(self.now, slots)

    # -- the record ------------------------------------------------------------------------------------------

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

    # -- wrong workers ---------------------------------------------------------------------------------------

    def _judge(self, job: JobState, key: ChunkKey) -> None:
        audit = self._auditing.open.get(key)
        verdict = audit.verdict() if audit is not None else None
        if audit is None or verdict is None:
            return
        self._auditing.close(key)
        if not verdict.right:
            reason = (
                f"rows [{key.start}, {key.stop}) of {key.phase} {key.iteration} gave different values on each of "
                f"{', '.join(audit.opinions)}: the rollouts are not reproducible"
            )
            self._close(job, "failed", reason)
            return
        if audit.counted in verdict.right:
            other = next(w for w in verdict.right if w != audit.counted)
            self._out.append(E.Confirm(key.job, key.phase, key.iteration, key.start, audit.epoch, other))
        for wrong in verdict.wrong:
            self._quarantine(
                wrong,
                f"its values for rows [{key.start}, {key.stop}) of {key.phase} {key.iteration} of job {key.job} are "
                f"not those of {' and '.join(verdict.right)}",
            )

    def _quarantine(self, name: str, reason: str) -> None:
        self.workers.quarantined[name] = reason
        self._auditing.drop_worker(name)
        self._voiding.add(name)
        self._out.append(E.Quarantine(name, reason))
        if name in self.workers.here:
            self._leave(name, lost=0)

    def _voided(self, event: E.Voided) -> None:
        self._voiding.discard(event.worker)
        why = self.workers.quarantined.get(event.worker, "")
        for name in event.jobs:
            job = self.jobs.get(name)
            if job is not None:
                self._out.append(E.Tell(name, "quarantine", {"worker": event.worker, "reason": why}))
                self._open(job)

    # -- time ------------------------------------------------------------------------------------------------

    def _tick(self, _: E.Tick) -> None:
        for lease in self.workers.expired(self.now):
            self._take_back(lease, lost=1, reason="its time was up")
        self._deal()
        for slot, waiting in list(self.workers.waiting.items()):
            if waiting.until <= self.now:
                del self.workers.waiting[slot]
                self._out.append(E.Send(waiting.request, Nothing()))
        for job in list(self.jobs.values()):
            self._settle(job)
            if job.told != job.rollouts and self.now - job.told_at >= self.policy.progress_s:
                job.told, job.told_at = job.rollouts, self.now
                self._out.append(E.Tell(job.id, "progress", {"rollouts": job.rollouts}, kept=False))


_HANDLERS: dict[type, Callable[[Scheduler, Any], None]] = {
    E.Submitted: Scheduler._submitted,
    E.Opened: Scheduler._turned,
    E.Stepped: Scheduler._turned,
    E.Broken: Scheduler._broken,
    E.Cancelled: Scheduler._cancelled,
    E.Paused: Scheduler._paused,
    E.Resumed: Scheduler._resumed,
    E.Said: Scheduler._said,
    E.Garbled: Scheduler._garbled,
    E.Gone: Scheduler._gone,
    E.Recorded: Scheduler._recorded,
    E.StoreTrouble: Scheduler._store_trouble,
    E.StoreWell: Scheduler._store_well,
    E.Voided: Scheduler._voided,
    E.Tick: Scheduler._tick,
}
