"""What the database is to take, in order.

Where it takes nothing (a full disk, a lock), what it was to take waits here, and the scheduler deals out nothing until
all of it is taken.
"""

import logging
from collections import deque
from collections.abc import Callable

from service.errors import StoreError, Superseded
from service.evaluation.store.jobs import OPEN, Event, JobRow, JobStore, taken_up_again
from service.remote.fleet import events as E
from service.remote.fleet.outage import RETRY_S

GROUP = 512  # answers at most in one transaction

log = logging.getLogger("tailroad.hub")


class Writes:
    """Instructions for the database, carried out by the hub's thread in the order in which they came."""

    def __init__(
        self,
        store: JobStore,
        now: Callable[[], float],
        handle: Callable[[E.Event], None],
        publish: Callable[[Event], None],
        over: Callable[[str, str], None],
        take_up: Callable[[JobRow], None],
    ):
        """Begin with none.

        now: seconds that pass as the hub counts them
        handle: has the scheduler know what became of them
        publish: told of events that are in the database
        over: told of a job that is over and its status
        take_up: has a job go on that was over
        """
        self._store, self._now, self._handle, self._publish = store, now, handle, publish
        self._over, self._take_up = over, take_up
        self._waiting: deque[E.Instruction] = deque()
        self._trouble_until: float | None = None

    def add(self, instruction: E.Instruction) -> None:
        """Have it wait for its turn."""
        self._waiting.append(instruction)

    def carry_out(self) -> None:
        """Carry out what waits; Superseded where another scheduler has taken over."""
        if self._trouble_until is not None and self._now() < self._trouble_until:
            return
        try:
            while self._waiting:
                self._write_next()
        except Superseded:
            raise  # this scheduler ends
        except StoreError as error:
            log.error("%s; trying again", error)
            if self._trouble_until is None:
                self._handle(E.StoreTrouble(str(error)))
            self._trouble_until = self._now() + RETRY_S
            return
        if self._trouble_until is not None:
            self._trouble_until = None
            self._handle(E.StoreWell())

    def _write_next(self) -> None:
        match self._waiting[0]:
            case E.Record():
                self._write_records()
            case E.SetStatus() as status:
                self._write_status(status)
            case E.Publish() as news:
                event = self._store.add_event(news.job, news.kind, news.body)
                self._written()
                self._publish(event)
            case E.Note() as note:
                self._store.add_iterations(note.job, note.epoch, note.first, list(note.records))
                self._written()
            case E.Confirm(audit):
                self._store.add_audits([audit])
                self._written()
            case E.Quarantine() as wrong:
                self._write_quarantine(wrong)
            case other:
                raise TypeError(f"{other!r} is nothing for the database")

    def _write_records(self) -> None:
        """All chunks that wait one after the other, in one transaction."""
        group: list[E.Record] = []
        for instruction in self._waiting:
            if not isinstance(instruction, E.Record) or len(group) == GROUP:
                break
            group.append(instruction)
        self._store.append((r.job, r.phase, r.iteration, r.chunk, r.origin) for r in group)
        self._written(len(group))
        self._handle(E.Recorded(tuple(r.ticket for r in group)))

    def _write_status(self, instruction: E.SetStatus) -> None:
        job, status = instruction.job, instruction.status
        event = self._store.add_event(job, "status", {"status": status, "reason": instruction.reason})
        self._written()
        self._publish(event)
        if status not in OPEN:
            self._over(job, status)

    def _write_quarantine(self, instruction: E.Quarantine) -> None:
        worker, reason = instruction.worker, instruction.reason
        jobs = self._store.quarantine(worker, reason, instruction.also)
        self._written()
        log.warning("worker %s is in quarantine: %s", worker, reason)
        self._handle(E.Voided(worker, tuple(jobs)))
        self._reopen(jobs, worker)

    def _written(self, count: int = 1) -> None:
        for _ in range(count):
            self._waiting.popleft()

    def _reopen(self, jobs: list[str], worker: str) -> None:
        """Jobs that were done with rollouts of a worker found wrong since, and that the database has running again, are
        taken up."""
        for name in jobs:
            row = self._store.job(name)
            if row is not None and (row.status, row.reason) == ("running", taken_up_again(worker)):
                self._publish(self._store.events(name, limit=2**31 - 1)[-1])
                self._take_up(row)
