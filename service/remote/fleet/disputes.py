"""Chunks on which workers disagree, and what becomes of workers that are wrong."""

from service.evaluation.store.jobs import AuditRow
from service.remote.fleet import events as E
from service.remote.fleet.job_lifecycle import JobLifecycle
from service.remote.fleet.jobs import JobState, Phase
from service.remote.fleet.leases import Leases
from service.remote.fleet.messages import ChunkKey
from service.remote.fleet.state import SchedulerState


class Disputes:
    """The judging side of the scheduler."""

    def __init__(self, state: SchedulerState, lifecycle: JobLifecycle, leases: Leases):
        self._state, self._lifecycle, self._leases = state, lifecycle, leases
        self._jobs, self._workers, self._auditing = state.jobs, state.workers, state.auditing

    def judge(self, job: JobState, key: ChunkKey) -> None:
        """Close the audit of a chunk where it is decided: who was wrong goes into quarantine; where nobody agrees with
        anybody, the job fails."""
        audit = self._auditing.open.get(key)
        verdict = audit.verdict() if audit is not None else None
        if audit is None or verdict is None:
            return
        self._auditing.close(key)
        self._workers.tally.audited += 1
        self._workers.tally.wrong += len(verdict.wrong)
        if not verdict.right:
            reason = (
                f"rows [{key.start}, {key.stop}) of {key.phase} {key.iteration} gave different values on each of "
                f"{', '.join(audit.opinions)}: the rollouts are not reproducible"
            )
            self._lifecycle.close(job, "failed", reason)
            return
        if audit.counted in verdict.right:
            other = next(w for w in verdict.right if w != audit.counted)
            self._state.do(
                E.Confirm(AuditRow(key.job, key.phase, key.iteration, key.start, audit.epoch, other))
            )
        for wrong in verdict.wrong:
            self.quarantine(
                wrong,
                f"its values for rows [{key.start}, {key.stop}) of {key.phase} {key.iteration} of job {key.job} are "
                f"not those of {' and '.join(verdict.right)}",
            )

    def quarantine(self, name: str, reason: str) -> None:
        """Refuse a worker from now on, and void what it did and nobody confirmed."""
        self._workers.quarantined[name] = reason
        self._auditing.drop_worker(name)
        self._state.voiding.add(name)
        self._state.do(E.Quarantine(name, reason))
        if name in self._workers.here:
            self._leases.leave(name, lost=0)

    def voided(self, event: E.Voided) -> None:
        """Open the jobs anew whose record has lost chunks."""
        self._state.voiding.discard(event.worker)
        why = self._workers.quarantined.get(event.worker, "")
        for name in event.jobs:
            job = self._jobs.get(name)
            if job is not None:
                self._state.do(E.Publish(name, "quarantine", {"worker": event.worker, "reason": why}))
                if job.phase is not Phase.WAITING:  # it reads its record when its turn comes
                    self._lifecycle.open(job)
