"""What becomes of workers that are wrong."""

from service.remote.fleet import events as E
from service.remote.fleet.jobs import JobState, Phase
from service.remote.fleet.leases import Leases
from service.remote.fleet.messages import ChunkKey


class Verdicts(Leases):
    """The judging side of the scheduler."""

    def _judge(self, job: JobState, key: ChunkKey) -> None:
        audit = self._auditing.open.get(key)
        verdict = audit.verdict() if audit is not None else None
        if audit is None or verdict is None:
            return
        self._auditing.close(key)
        self.workers.tally.audited += 1
        self.workers.tally.wrong += len(verdict.wrong)
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
                if job.phase is not Phase.WAITING:  # it reads its record when its turn comes
                    self._open(job)
