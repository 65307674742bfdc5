"""What workers say, and what they are told."""

from service.evaluation.store import Chunk
from service.remote.fleet import events as E
from service.remote.fleet.jobs import Flight, Phase
from service.remote.fleet.messages import Answer, Ask, Bye, Failed, Hello, Noted, Nothing, Refused, Welcome
from service.remote.fleet.verdicts import Verdicts
from service.remote.fleet.workers import Waiting, WorkerState


class Hearing(Verdicts):
    """The workers' side of the scheduler."""

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
        self.workers.join(WorkerState(message.worker, message.capabilities, self.now))
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
