"""What becomes of jobs: opened, stepped from batch to batch, paused, cancelled, settled."""

import msgspec

from service.remote.fleet import events as E
from service.remote.fleet.jobs import JobState, Phase
from service.remote.fleet.ledger import Ledger
from service.remote.fleet.turns import IterationRecord

NO_ROOM = "the jobs that are open hold the memory that all may hold together; it begins when some of them have ended"


class Careers(Ledger):
    """The jobs' side of the scheduler."""

    def _submitted(self, event: E.Submitted) -> None:
        if event.job in self.jobs:
            return
        job = JobState(event, phase=Phase.WAITING, paused=event.paused)
        self.jobs[job.id] = job
        self._admit()
        if job.phase is Phase.WAITING and not job.paused:
            self._out.append(E.Tell(job.id, "waiting", {"reason": NO_ROOM}))

    def _admit(self) -> None:
        """Open jobs that wait, the highest priority first, as far as there is memory for all open ones; one at least,
        and none before its turn, so that a large one is not passed over for ever."""
        waiting = [j for j in self.jobs.values() if j.phase is Phase.WAITING and not j.paused]
        if not waiting:
            return
        here = [j for j in self.jobs.values() if j.phase is not Phase.WAITING]
        for job in sorted(waiting, key=lambda j: -j.submitted.priority):
            held = sum(j.submitted.held_bytes for j in here)
            if here and held + job.submitted.held_bytes > self.policy.open_bytes:
                return
            peers = [j.spent_s for j in here if j.submitted.priority == job.submitted.priority]
            job.spent_s = min(peers, default=0.0)
            here.append(job)
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
            self._admit()
            self._deal()

    def _close(self, job: JobState, status: str, reason: str = "") -> None:
        del self.jobs[job.id]
        self._auditing.drop_job(job.id)
        self._out.append(E.SetStatus(job.id, status, reason))
        self._admit()
        self._deal()

    def _settle(self, job: JobState) -> None:
        """End a job whose algorithm has finished, unless an audit is open that somebody can run."""
        if job.phase is not Phase.SETTLING or self._voiding:
            return
        if not self._auditing.holds_back(job, self.workers):
            self._close(job, "done")
        elif not job.waiting and self._auditing.needs_another(job, self.workers):
            job.waiting = True
            reason = "two workers disagree and none of the others is there to decide; start another worker"
            self._out.append(E.Tell(job.id, "waiting", {"reason": reason}))
