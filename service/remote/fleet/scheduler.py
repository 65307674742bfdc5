"""The scheduler: a state machine. It is told what happened and answers what is to be done; it does nothing itself.

    instructions = scheduler.handle(now, event)

`now` is any clock's seconds; one that goes back is taken to stand still. The same events give the same instructions.
Every chunk counts once: its rows are in one of these states, and only the record is counted.

    rows are             because of                               and then
    pending              begin of a batch, a lease taken back     out, when a slot that waits is assigned them
    out (a flight)       Lease sent                               on their way, when the first answer comes;
                                                                  pending again, when their last lease is lost
    on their way         Answer, or given up after many losses    in the record, with Recorded
    (a ticket)
    in the record        Recorded                                 pending in a later epoch, where they are voided

A job's phases and what follows on each are in `service.remote.fleet.jobs`. A worker is unknown until its Hello, here
until its Bye, its loss or a second Hello, and in quarantine for good once it was found wrong.

The parts work on one state (`SchedulerState`), each on those before it: Assignment (who gets what), JobLifecycle,
Leases (what becomes of chunks), Disputes (who is wrong), WorkerProtocol (what workers say).
"""

from service.remote.fleet import events as E
from service.remote.fleet.assignment import Assignment
from service.remote.fleet.auditing import Auditing
from service.remote.fleet.disputes import Disputes
from service.remote.fleet.job_lifecycle import JobLifecycle
from service.remote.fleet.jobs import JobState
from service.remote.fleet.leases import Leases
from service.remote.fleet.messages import Nothing
from service.remote.fleet.policy import STANDARD, Policy
from service.remote.fleet.state import SchedulerState
from service.remote.fleet.worker_protocol import WorkerProtocol
from service.remote.fleet.workers import Workers


class Scheduler:
    """The scheduler as a state machine: events in, instructions out.

    versions: what a worker must be made of (service.remote.fleet.versions)
    secret: decides what is audited
    """

    def __init__(
        self,
        versions: dict[str, str],
        policy: Policy = STANDARD,
        quarantined: dict[str, str] | None = None,
        secret: bytes = b"",
    ):
        self._state = state = SchedulerState(
            policy, versions, Workers(quarantined or {}), Auditing(policy, secret)
        )
        self._assignment = Assignment(state)
        self._lifecycle = JobLifecycle(state, self._assignment)
        self._leases = Leases(state, self._assignment, self._lifecycle)
        self._disputes = Disputes(state, self._lifecycle, self._leases)
        self._protocol = WorkerProtocol(
            state, self._assignment, self._lifecycle, self._leases, self._disputes
        )

    @property
    def jobs(self) -> dict[str, JobState]:
        """Those that are not over, by id."""
        return self._state.jobs

    @property
    def workers(self) -> Workers:
        return self._state.workers

    @property
    def now(self) -> float:
        return self._state.now

    @property
    def trouble(self) -> str:
        """Why the database takes nothing, "" where it does."""
        return self._state.trouble

    def disputed(self, job: str) -> bool:
        """Whether workers disagree on some of the job's rollouts."""
        return self._state.auditing.disputed(job)

    def handle(self, now: float, event: E.Event) -> list[E.Instruction]:
        """What is to be done now that this has happened."""
        self._state.now = max(self._state.now, now)
        match event:
            case E.Submitted():
                self._lifecycle.submitted(event)
            case E.Opened() | E.Stepped():
                self._lifecycle.stepped(event)
            case E.Broken():
                self._lifecycle.broken(event)
            case E.Cancelled():
                self._lifecycle.cancelled(event)
            case E.Paused():
                self._lifecycle.paused(event)
            case E.Resumed():
                self._lifecycle.resumed(event)
            case E.Told(job, kind, body):
                self._state.instructions.append(E.Publish(job, kind, body))
            case E.Requested():
                self._protocol.requested(event)
            case E.Garbled():
                self._protocol.garbled(event)
            case E.Gone():
                self._protocol.gone(event)
            case E.Recorded():
                self._leases.recorded(event)
            case E.StoreTrouble():
                self._leases.store_trouble(event)
            case E.StoreWell():
                self._leases.store_well()
            case E.Settled():
                self._disputes.settled(event)
            case E.Voided():
                self._disputes.voided(event)
            case E.Tick():
                self._tick()
            case _:
                raise TypeError(f"{event!r} is no event")
        instructions, self._state.instructions = self._state.instructions, []
        return instructions

    def _tick(self) -> None:
        now, workers = self.now, self.workers
        for lease in workers.expired(now):
            self._leases.take_back(lease, lost=1, reason="its time was up")
        self._assignment.assign(copies=True)
        for slot, waiting in list(workers.waiting.items()):
            if waiting.until <= now:
                del workers.waiting[slot]
                self._state.send(waiting.request, Nothing())
        for job in list(self.jobs.values()):
            self._lifecycle.settle(job)
            if job.reported != job.rollouts and now - job.reported_at >= self._state.policy.progress_s:
                job.reported, job.reported_at = job.rollouts, now
                self._state.do(E.Publish(job.id, "progress", {"rollouts": job.rollouts}, kept=False))
