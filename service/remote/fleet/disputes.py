"""Chunks on which workers disagree, settled by a replay on this machine, and what becomes of workers that are wrong."""

from service.evaluation.store.jobs import AuditRow
from service.remote.fleet import events as E
from service.remote.fleet.audits import Audit
from service.remote.fleet.job_lifecycle import JobLifecycle
from service.remote.fleet.jobs import JobState, Phase
from service.remote.fleet.leases import Leases
from service.remote.fleet.messages import ChunkKey
from service.remote.fleet.referee import NAME as REFEREE
from service.remote.fleet.state import SchedulerState


class Disputes:
    """The judging side of the scheduler."""

    def __init__(self, state: SchedulerState, lifecycle: JobLifecycle, leases: Leases):
        self._state, self._lifecycle, self._leases = state, lifecycle, leases
        self._jobs, self._workers, self._auditing = state.jobs, state.workers, state.auditing
        self._policy = state.policy

    def judge(self, job: JobState, key: ChunkKey) -> None:
        """Close the audit of a chunk where two agree; where they do not, have this machine run it."""
        audit = self._auditing.open.get(key)
        if audit is None or len(audit.opinions) < 2:
            return
        if not audit.disputed:
            self._auditing.close(key)
            self._workers.tally.audited += 1
            self._confirm(audit)
        elif not audit.settling:
            audit.settling = True
            limit_s = max(self._policy.first_limit_s, job.limit_s(self._policy, key.stop - key.start))
            self._state.do(E.Settle(key, audit.rows, limit_s))
            body = {"rows": [key.start, key.stop], "phase": key.phase, "iteration": key.iteration,
                    "workers": list(audit.opinions)}  # fmt: skip
            self._state.do(E.Publish(job.id, "disputed", body))

    def settled(self, event: E.Settled) -> None:
        """This machine has run a chunk that workers disagree on: who came to something else goes into quarantine; where
        it cannot tell, the job stops as disputed."""
        key = event.key
        audit, job = self._auditing.open.get(key), self._jobs.get(key.job)
        if audit is None or job is None:
            return
        audit.settling = False
        if not audit.disputed:  # one of them is in quarantine meanwhile
            self.judge(job, key)
            return
        rows = f"rows [{key.start}, {key.stop}) of {key.phase} {key.iteration}"
        if event.bits not in audit.opinions.values():
            why = event.reason or "this machine came to something else than any of them"
            who = " and ".join(audit.opinions)
            self._lifecycle.close(
                job, "failed", f"disputed: {who} gave different values for {rows}, and {why}"
            )
            return
        self._auditing.close(key)
        self._workers.tally.audited += 1
        wrong = [name for name, bits in audit.opinions.items() if bits != event.bits]
        self._workers.tally.wrong += len(wrong)
        if audit.counted not in wrong:
            self._confirm(audit, REFEREE)
        for name in wrong:
            reason = (
                f"its values for {rows} of job {key.job} are not those of a replay on the scheduler's machine"
            )
            self.quarantine(name, reason)
        self._lifecycle.settle(job)

    def _confirm(self, audit: Audit, by: str = "") -> None:
        """Write down that another identity than the one that counts came to the same bits.

        by: who, where known
        """
        mine = self._workers.identity(audit.counted)
        others = (name for name in audit.opinions if self._workers.identity(name) not in ("", mine))
        other = by or (next(others, "") if mine else "")
        if other:
            key = audit.key
            row = AuditRow(key.job, key.phase, key.iteration, key.start, audit.epoch, other)
            self._state.do(E.Confirm(row))

    def quarantine(self, name: str, reason: str) -> None:
        """Refuse a worker from now on, with its certificate and host, and void what they did and nobody confirmed."""
        worker = self._workers.here.get(name)
        banned = worker.peer.banned if worker is not None else ()
        self._workers.quarantined |= dict.fromkeys(banned, reason)
        for other in [w.id for w in self._workers.here.values() if set(w.peer.banned) & set(banned)] or [
            name
        ]:
            self._bar(other, reason, banned)

    def _bar(self, name: str, reason: str, banned: tuple[str, ...]) -> None:
        self._workers.quarantined[name] = reason
        self._auditing.drop_worker(name)
        self._state.voiding.add(name)
        self._state.do(E.Quarantine(name, reason, banned))
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
