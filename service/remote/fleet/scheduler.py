"""The scheduler: a state machine. It is told what happened and answers what is to be done; it does nothing itself.

    instructions = scheduler.handle(now, event)

`now` is any clock's seconds; one that goes back is taken to stand still. The same events give the same instructions.
Every chunk counts once: its rows are either pending, out (a flight), on their way to the record (a ticket) or in the
record, and only the record is counted.

It is made in layers, each of which knows those before it: Ledger (what is known), Careers (jobs), Leases (chunks),
Verdicts (wrong workers), Hearing (what workers say), and this file, which tells them apart.
"""

from collections.abc import Callable
from typing import Any

from service.remote.fleet import events as E
from service.remote.fleet.hearing import Hearing
from service.remote.fleet.messages import Nothing
from service.remote.fleet.policy import STANDARD, Policy


class Scheduler(Hearing):
    """versions: what a worker must be made of (service.remote.fleet.versions); secret: decides what is audited."""

    def __init__(
        self,
        versions: dict[str, str],
        policy: Policy = STANDARD,
        quarantined: dict[str, str] | None = None,
        secret: bytes = b"",
    ):
        super().__init__(versions, policy, quarantined or {}, secret)

    def handle(self, now: float, event: E.Event) -> list[E.Instruction]:
        """What is to be done now that this has happened."""
        self.now = max(self.now, now)
        _HANDLERS[type(event)](self, event)
        out, self._out = self._out, []
        return out

    def _tick(self, _: E.Tick) -> None:
        for lease in self.workers.expired(self.now):
            self._take_back(lease, lost=1, reason="its time was up")
        self._deal(copies=True)
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
