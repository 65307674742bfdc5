"""The workers' protocol as the scheduler keeps it: what each of their messages brings about, and its reply."""

from service.evaluation.store import Chunk
from service.remote.fleet import events as E
from service.remote.fleet.assignment import Assignment
from service.remote.fleet.disputes import Disputes
from service.remote.fleet.job_lifecycle import JobLifecycle
from service.remote.fleet.jobs import Flight, Phase
from service.remote.fleet.leases import Leases
from service.remote.fleet.messages import Answer, Ask, Bye, Failed, Hello, Noted, Nothing, Refused, Welcome
from service.remote.fleet.peers import Peer
from service.remote.fleet.state import SchedulerState
from service.remote.fleet.workers import Waiting, WorkerState


class WorkerProtocol:
    """The workers' side of the scheduler."""

    def __init__(
        self,
        state: SchedulerState,
        assignment: Assignment,
        lifecycle: JobLifecycle,
        leases: Leases,
        disputes: Disputes,
    ):
        self._state, self._assignment, self._lifecycle = state, assignment, lifecycle
        self._leases, self._disputes = leases, disputes
        self._jobs, self._workers = state.jobs, state.workers
        self._auditing, self._policy = state.auditing, state.policy

    def requested(self, event: E.Requested) -> None:
        """A worker's message, for which it wants a reply."""
        request, name = event.request, event.message.worker
        if refusal := self._workers.refusal(name, event.peer):
            self._state.send(request, Refused(refusal))
            return
        if self._is_another(name, event.peer):
            host = self._workers.here[name].capabilities.host
            where = f", of host {host}" if host else ""
            text = f"there is a worker named {name} already{where}; give this one another --name"
            self._state.send(request, Refused(text, again=True, taken=True))
            return
        if name not in self._workers.here and not isinstance(event.message, Hello):
            self._state.send(request, Refused(f"worker {name} has not said hello", unknown=True))
            return
        match event.message:
            case Hello() as message:
                self._hello(request, message, event.peer)
            case Ask() as message:
                self._ask(request, message)
            case Answer() as message:
                assert event.chunk is not None
                self._answer(request, message, event.chunk)
            case Failed() as message:
                self._failed(message)
                self._state.send(request, Noted(False))
                self._assignment.assign()
            case Bye():
                self._state.send(request, Noted(False))
                self._leases.leave(name, lost=0)

    def _is_another(self, name: str, peer: Peer) -> bool:
        """Whether a worker of that name is here that speaks over another connection."""
        known = self._workers.here[name].peer if name in self._workers.here else peer
        return bool(known.session and peer.session) and known.session != peer.session

    def _hello(self, request: int, message: Hello, peer: Peer) -> None:
        theirs = message.capabilities.versions
        for what, ours in self._state.versions.items():
            if theirs.get(what) != ours:
                reason = (
                    f"worker {message.worker} has {what} {theirs.get(what, 'unknown')}, the scheduler {ours}, so that "
                    "its rollouts may have other bits; install the same tailroad with the same constraints on both"
                )
                self._state.send(request, Refused(reason))
                return
        if len(self._workers.here) >= self._policy.max_workers and message.worker not in self._workers.here:
            reason = f"there are {self._policy.max_workers} workers already"
            self._state.send(request, Refused(reason, again=True))
            return
        if message.worker in self._workers.here:  # it was started again
            self._leases.leave(message.worker, lost=1)
        self._workers.join(WorkerState(message.worker, message.capabilities, self._state.now, peer))
        self._state.send(request, Welcome(self._policy.hold_s))

    def _ask(self, request: int, ask: Ask) -> None:
        slot = (ask.worker, ask.slot)
        procs = self._workers.here[ask.worker].capabilities.procs
        if not 0 <= ask.slot < procs:
            reason = f"slot {ask.slot} of worker {ask.worker}, which has {procs}"
            self._state.send(request, Refused(reason))
            return
        for lease in self._workers.of_slot(*slot):  # the slot never got it
            self._leases.take_back(lease, lost=0)
        if slot in self._workers.waiting:
            self._state.send(self._workers.waiting.pop(slot).request, Nothing())
        self._workers.waiting[slot] = Waiting(request, ask, self._state.now + self._policy.hold_s)
        self._assignment.assign([slot])

    def _answer(self, request: int, answer: Answer, chunk: Chunk) -> None:
        key, name = answer.chunk, answer.worker
        job = self._jobs.get(key.job)
        if job is not None and job.phase is Phase.OPENING:
            self._state.send(request, Refused(f"job {key.job} is being opened", again=True))
            return
        held = self._workers.release(answer.lease, name)
        worker = self._workers.here[name]
        worker.chunks += 1
        worker.rollouts += chunk.f.size
        worker.worker_s += chunk.worker_s
        if job is None:
            self._state.send(request, Noted(False))
            return
        if held is not None and held.expected_s is not None:
            job.spent_s += (chunk.worker_s - held.expected_s) / job.submitted.weight
        span = (key.start, key.stop)
        if held is not None and (shown := self._auditing.repeats.answered(held, chunk)) is not None:
            self._state.do(E.Publish(job.id, "repeated", shown))
        elif self._auditing.opinion(key, name, chunk):
            self._disputes.judge(job, key)
        elif not job.is_of_batch(key):
            pass
        elif span in job.flights or (claimed := job.pending.claim(*span)) is not None:
            if span not in job.flights:
                assert claimed is not None
                job.flights[span] = Flight(claimed)
            job.timed(chunk)
            self._leases.record(job, key, chunk, name, request)
            return
        elif span in job.answers:
            bits, first = job.answers[span]
            self._auditing.second(job, key, first, bits, name, chunk)
            self._disputes.judge(job, key)
        self._state.send(request, Noted(False))
        self._lifecycle.settle(job)

    def _failed(self, message: Failed) -> None:
        held = self._workers.leases.get(message.lease)
        if held is None or held.worker != message.worker:
            return
        job = self._jobs.get(held.key.job)
        if message.explicit:
            self._workers.here[message.worker].draws_wrong = True
        elif message.refused and job is not None:
            job.refused[message.worker] = message.reason
            self._state.do(E.Publish(job.id, "refused", {"worker": message.worker, "reason": message.reason}))
        self._leases.take_back(
            message.lease, lost=0 if message.refused or message.explicit else 1, reason=message.reason
        )

    def garbled(self, event: E.Garbled) -> None:
        """A message that cannot be read; too many of them, and the worker goes into quarantine."""
        worker = self._workers.here.get(event.worker)
        if worker is None or self._is_another(event.worker, event.peer):
            return
        worker.garbled += 1
        if worker.garbled >= self._policy.garbled:
            self._disputes.quarantine(
                event.worker, f"{worker.garbled} answers that cannot be read, the last one: {event.reason}"
            )

    def gone(self, event: E.Gone) -> None:
        """The worker's connection is lost."""
        if event.worker in self._workers.here:
            self._leases.leave(event.worker, lost=1)
