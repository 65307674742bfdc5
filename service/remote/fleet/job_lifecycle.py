"""What becomes of jobs: opened, stepped from batch to batch, paused, cancelled, settled (phases: jobs.py)."""

import msgspec

from service.remote.fleet import events as E
from service.remote.fleet.assignment import Assignment
from service.remote.fleet.batch_step import IterationRecord
from service.remote.fleet.jobs import JobState, Phase
from service.remote.fleet.state import SchedulerState

NO_ROOM = "the jobs that are open hold the memory that all may hold together; it begins when some of them have ended"


class JobLifecycle:
    """The jobs' side of the scheduler."""

    def __init__(self, state: SchedulerState, assignment: Assignment):
        self._state, self._assignment = state, assignment
        self._jobs, self._workers = state.jobs, state.workers
        self._auditing, self._policy = state.auditing, state.policy

    def submitted(self, event: E.Submitted) -> None:
        """Take up a job, or let it wait until there is memory for it."""
        if event.job in self._jobs:
            return
        job = JobState(event, phase=Phase.WAITING, paused=event.paused)
        self._jobs[job.id] = job
        self._admit()
        if job.phase is Phase.WAITING and not job.paused:
            self._state.do(E.Publish(job.id, "waiting", {"reason": NO_ROOM}))

    def _admit(self) -> None:
        """Open jobs that wait, the highest priority first, as far as there is memory for all open ones; one at least,
        and none before its turn, so that a large one is not passed over for ever."""
        waiting = [j for j in self._jobs.values() if j.phase is Phase.WAITING and not j.paused]
        if not waiting:
            return
        here = [j for j in self._jobs.values() if j.phase is not Phase.WAITING]
        for job in sorted(waiting, key=lambda j: -j.submitted.priority):
            held = sum(j.submitted.held_bytes for j in here)
            if here and held + job.submitted.held_bytes > self._policy.open_bytes:
                return
            peers = [j.spent_s for j in here if j.submitted.priority == job.submitted.priority]
            job.spent_s = min(peers, default=0.0)
            here.append(job)
            self.open(job)

    def open(self, job: JobState) -> None:
        """Have the record replayed; whatever is out is taken by its rows when it comes."""
        job.generation += 1
        job.phase = Phase.OPENING
        job.flights = {}
        self._state.do(E.Open(job.id, job.generation))

    def stepped(self, event: E.Opened | E.Stepped) -> None:
        """Begin the batch that the algorithm proposes now, or settle the job where there is none."""
        job = self._jobs.get(event.job)
        if job is None or job.generation != event.generation:
            return
        replay = event.replay
        if isinstance(event, E.Opened):
            job.epoch, job.rollouts, job.failed, job.first_failures = event.epoch, 0, 0, []
        job.count(replay.rollouts, replay.failed, replay.first_failures)
        self._note(job, replay.step.number - len(replay.records), *replay.records)
        if replay.step.batch is not None and self.fails(job):
            return
        if replay.step.batch is None:
            job.phase, job.step = Phase.SETTLING, replay.step
            self.settle(job)
        else:
            job.begin(replay.step)
            self._assignment.assign()

    def _note(self, job: JobState, first: int, *records: IterationRecord) -> None:
        if records:
            self._state.do(E.Note(job.id, job.epoch, first, records))
            body = {"number": first + len(records) - 1, "record": msgspec.to_builtins(records[-1])}
            self._state.do(E.Publish(job.id, "iteration", body, kept=False))

    def broken(self, event: E.Broken) -> None:
        """End a job that cannot go on."""
        job = self._jobs.get(event.job)
        if job is not None and job.generation == event.generation:
            self.close(job, "failed", event.reason)

    def cancelled(self, event: E.Cancelled) -> None:
        """End a job that nobody wants any more."""
        if event.job in self._jobs:
            self.close(self._jobs[event.job], "cancelled")

    def paused(self, event: E.Paused) -> None:
        """Assign none of the job's chunks until `resumed`; those that are out come in."""
        job = self._jobs.get(event.job)
        if job is not None and not job.paused:
            job.paused = True
            self._state.do(E.SetStatus(job.id, "paused"))

    def resumed(self, event: E.Resumed) -> None:
        """Go on with a paused job."""
        job = self._jobs.get(event.job)
        if job is not None and job.paused:
            job.paused = False
            self._state.do(E.SetStatus(job.id, "running"))
            self._admit()
            self._assignment.assign()

    def fails(self, job: JobState, at_end: bool = False) -> bool:
        """End a job of which too many rollouts failed; whether it is one.

        at_end: it has no more of them
        """
        why = job.failed_too_often(at_end)
        if why:
            self.close(job, "failed", why)
        return bool(why)

    def close(self, job: JobState, status: str, reason: str = "") -> None:
        """The job is over: forget it, and let others have what it held."""
        del self._jobs[job.id]
        self._auditing.drop_job(job.id)
        self._state.do(E.SetStatus(job.id, status, reason))
        self._admit()
        self._assignment.assign()

    def settle(self, job: JobState) -> None:
        """End a job whose algorithm has finished, unless an audit is open that somebody can run."""
        if job.phase is not Phase.SETTLING or self._state.voiding:
            return
        if not self._auditing.holds_back(job, self._workers) and not self.fails(job, at_end=True):
            self.close(job, "done")
