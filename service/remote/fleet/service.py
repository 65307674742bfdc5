"""What can be asked of a fleet and told to it, as plain functions: whoever offers them to others (an API, a command)
translates to and from its own words. Methods may be called from any thread.
"""

import secrets
import threading
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import msgspec

import ce
from service.errors import InputError, StoreError
from service.evaluation.doubts import DISPUTED, failed_job, not_repeatable, with_doubts
from service.evaluation.endings import endings_of
from service.evaluation.failed_share import MAX_FAILED
from service.evaluation.job import Job
from service.evaluation.listing import Listing, Wanted, listing_of
from service.evaluation.record import JobRecord, replay
from service.evaluation.so_far import ESTIMATE, begun, state_after
from service.evaluation.store.jobs import Event, JobRow, Mark
from service.evaluation.store.log import AuditLog
from service.evaluation.store.notes import NOTE
from service.evaluation.store.reader import JobReader
from service.evaluation.summary import Cost, summary_of
from service.remote.fleet import events as E
from service.remote.fleet.chunk_memory import ChunkMemory, JobChunks
from service.remote.fleet.errors import NoSuchJob
from service.remote.fleet.hub import Hub
from service.remote.fleet.scheduler import Scheduler
from service.remote.fleet.views import JobView, RunningChunk, Tally, WorkerView
from service.remote.fleet.workers import WorkerState
from service.world.egos.open import REMOTE
from service.world.scenario import Scenario
from service.world.scenario.measures import measure_kind

MAX_OPEN_JOBS = 1000
MAX_THRESHOLDS = 1000
Progress = tuple[
    int, int, dict[str, str], bool
]  # of an open job: rollouts, leases, refusals, whether it is disputed
WITHHELD = {
    "p": None,
    "std_error": None,
    "ci": [0.0, 1.0],
    "efficiency_vs_naive": None,
    "impacts": [],
}  # of a job that failed


class Fleet:
    """The fleet of a hub."""

    def __init__(self, hub: Hub):
        self._hub = hub
        self._store = hub.store
        self._chunks = ChunkMemory(hub.store.chunks)
        self._submitting = threading.Lock()

    # -- jobs ------------------------------------------------------------------------------------------------

    def submit(
        self,
        job: Job,
        priority: int = 0,
        weight: float = 1.0,
        label: str = "",
        max_failed: float = MAX_FAILED,
    ) -> JobView:
        """Record a job and have it run. Of two jobs the one of higher priority goes first; jobs of one priority share
        the workers by weight; a job of which a larger share than max_failed of the rollouts fails has failed.
        InputError for values out of range or too many open jobs."""
        if not 0.0 <= max_failed <= 1.0:
            raise InputError(f"max_failed {max_failed}: give a share from 0 to 1")
        if not -100 <= priority <= 100:
            raise InputError(f"priority {priority}: give a whole number from -100 to 100")
        if not 0.01 <= weight <= 100.0:
            raise InputError(f"weight {weight}: give a number from 0.01 to 100")
        if len(label) > 200:
            raise InputError(f"the label has {len(label)} characters; give at most 200")
        with self._submitting:  # so that of several that come together each counts those before it
            if self.open_jobs() >= MAX_OPEN_JOBS:
                raise InputError(f"there are {MAX_OPEN_JOBS} open jobs; wait for some to end, or cancel some")
            row = self._store.add_job(
                f"j{secrets.token_hex(6)}", job, priority, weight, label, "running", max_failed
            )
            self._hub.take_up(row)
        return self._view(row, {})

    def jobs(self, after: int = 0, limit: int = 100) -> list[JobView]:
        """Jobs in the order of submission, those after number `after`."""
        progress = self._progress()
        return [self._view(row, progress) for row in self._store.jobs(after, limit)]

    def job(self, job: str) -> JobView:
        """NoSuchJob for a job that there is not; so do all that follow."""
        return self._view(self._row(job), self._progress())

    def scenario(self, job: str) -> Scenario:
        """What the job runs."""
        return self._row(job).job.scenario

    def check(self) -> None:
        """StoreError where the database takes nothing, cannot be read, or is not one any more."""
        trouble = self._hub.call(lambda scheduler: scheduler.trouble).result()
        if trouble:
            raise StoreError(f"the database takes nothing: {trouble}")
        self._store.check()

    @property
    def log(self) -> AuditLog:
        """Who told the service to do what."""
        return self._store.log

    def open_of(self, who: str) -> set[str]:
        """The jobs that are not over and that this client has submitted."""
        here = self._hub.call(lambda scheduler: set(scheduler.jobs)).result()
        return here & self._store.log.submitted_by(who) if here else set()

    def open_jobs(self) -> int:
        """How many jobs are not over."""
        return self._hub.call(lambda scheduler: len(scheduler.jobs)).result()

    def cancel(self, job: str) -> None:
        """End a job for good; one that is over stays as it is."""
        self._post(job, E.Cancelled(job))

    def pause(self, job: str) -> None:
        """Run none of the job's rollouts until `resume`."""
        self._post(job, E.Paused(job))

    def resume(self, job: str) -> None:
        self._post(job, E.Resumed(job))

    def note(
        self,
        job: str,
        text: str | None = None,
        tags: tuple[str, ...] | None = None,
        archived: bool | None = None,
    ) -> None:
        """Keep words about a job, its tags, and whether it is put away; None: as it is. Earlier ones are kept."""
        known = self._row(job).note
        changes = {"text": text, "tags": tags, "archived": archived}
        said = msgspec.structs.replace(known, **{k: v for k, v in changes.items() if v is not None})
        if said == known:
            return
        self._hub.post(E.Told(job, NOTE, msgspec.to_builtins(said)))
        for _ in range(2):  # what is to be written is written between two looks
            self._hub.call(lambda scheduler: None).result()

    # -- what they come to -----------------------------------------------------------------------------------

    def mark(self, job: str) -> Mark:
        """How the job's record is now: what follows from it is the same while this is the same."""
        return self._store.mark(self._row(job).id)

    def at_hand(self, job: str) -> bool:
        """Whether estimate and curve answer at once, without replaying the record."""
        self._row(job)
        return self._hub.statistics.at_hand(job)

    def make_ready(self, job: str) -> None:
        """Replay the record of a job that is over; a long one takes minutes."""
        self._hub.statistics.last(job)

    def estimate(
        self, job: str, gamma: float | None = None, confidence: float | None = None
    ) -> dict[str, Any]:
        """The estimate so far as `tailroad estimate --json` prints it, from the batches that are complete and the first
        rows of one that is not; at another threshold or confidence where given. Of a job that failed p and its interval
        are withheld."""
        row, cost = self._row(job), Cost(0)
        read = self._chunks.of(row.id)
        found = self._estimate(job, gamma, confidence, read)
        cost.add(read.worker_s, read.steps * row.job.scenario.time.step_s, read.in_sumo)
        endings = endings_of(found, read.chunks)
        found = with_doubts(found, self.doubts(job))
        told = summary_of(msgspec.structs.replace(row.job, gamma=found.gamma), found, cost, endings)
        return told | WITHHELD if row.status == "failed" else told

    def doubts(self, job: str) -> tuple[ce.EstimateWarning, ...]:
        """What its record has to say of the job's estimate now."""
        row = self._row(job)
        if row.status == "failed":
            return (failed_job(row.reason),)
        disputed = self._hub.call(lambda scheduler: scheduler.disputed(job)).result()
        seen = self._store.events_of(job, "repeated") if row.job.ego.startswith(REMOTE) else []
        return ((DISPUTED,) if disputed else ()) + not_repeatable(event.body for event in seen)

    def curve(self, job: str, gammas: Sequence[float], confidence: float | None = None) -> ce.Curve:
        """p and its pointwise interval at each threshold, from the same rollouts."""
        if not 1 <= len(gammas) <= MAX_THRESHOLDS:
            raise InputError(f"{len(gammas)} thresholds; give 1 to {MAX_THRESHOLDS}")
        if (row := self._row(job)).status == "failed":
            raise InputError(f"job {job} has failed, and its p is withheld: {row.reason}")
        return self._estimate(job, None, confidence).curve(gammas)

    def course(self, job: str, points: int, confidence: float | None = None) -> tuple[int, ce.Trace]:
        """Rollouts of the search, and the estimate after each of about `points` numbers of those that came after."""
        if (row := self._row(job)).status == "failed":
            raise InputError(f"job {job} has failed, and its p is withheld: {row.reason}")
        found = self._estimate(job, None, confidence)
        return found.training_rollouts, found.trace(points)

    def iterations(self, job: str, after: int = -1, limit: int = 1000) -> list[dict[str, Any]]:
        """What each batch came to (ce.TrainingRecord, ce.EstimationRecord), with its number."""
        self._row(job)
        return self._store.iterations(job, after, limit)

    def listing(self, job: str, wanted: Wanted, by: str, offset: int, limit: int) -> Listing:
        """Some of the rollouts on record (`service.evaluation.listing`)."""
        self._row(job)
        return listing_of(self._chunks.of(job).chunks, wanted, by, offset, limit)

    def record(self, job: str, gamma: float | None = None, outcome: str | None = None) -> JobRecord:
        """The job's whole record, replayed: failures, dangerous rollouts, the seeds that bring a rollout back. It reads
        everything; keep it rather than ask again.

        gamma: of the event f <= gamma instead of the job's own
        outcome: of the event that a rollout ends so
        """
        return replay(self.reader(job), self._row(job).job, gamma, outcome)

    def reader(self, job: str) -> JobReader:
        """The job's chunks, as `service.evaluation.record` and `service.analysis.report` read a run directory."""
        return JobReader(self._store, self._row(job))

    # -- what they tell --------------------------------------------------------------------------------------

    def events(self, job: str, after: int = 0, limit: int = 1000) -> list[Event]:
        """What the job told after event number `after`: its statuses and what is worth keeping."""
        self._row(job)
        return self._store.events(job, after, limit)

    def listen(self, listener: Callable[[Event], None]) -> None:
        """Be told what jobs tell, as it happens, in the hub's thread: be quick. Progress and iterations come with
        number 0 and are not kept."""
        self._hub.listen(listener)

    # -- workers ---------------------------------------------------------------------------------------------

    def workers(self) -> list[WorkerView]:
        """Those connected now, and those in quarantine."""
        return self._hub.call(_workers).result()

    def tally(self) -> Tally:
        """Lost, copied and audited chunks."""
        return self._hub.call(
            lambda scheduler: msgspec.convert(scheduler.workers.tally, Tally, from_attributes=True)
        ).result()

    # -- inside ----------------------------------------------------------------------------------------------

    def _row(self, job: str) -> JobRow:
        row = self._store.job(job)
        if row is None:
            raise NoSuchJob(job)
        return row

    def _post(self, job: str, event: E.Event) -> None:
        self._row(job)
        self._hub.post(event)

    def _estimate(
        self, job: str, gamma: float | None, confidence: float | None, read: JobChunks | None = None
    ) -> ce.Estimate:
        problem, step = self._hub.statistics.last(job)
        algorithm, state = problem.algorithm, step.state
        batch = step.batch or algorithm.propose(state)
        if batch is not None and batch.phase == ESTIMATE:
            part = begun(batch, (read or self._chunks.of(job)).chunks)
            state = state if part is None else state_after(algorithm, state, *part)
        found = algorithm.estimate(state)
        if confidence is not None:
            if not 0.0 < confidence < 1.0:
                raise InputError(f"confidence {confidence}: give a number between 0 and 1")
            found = replace(found, confidence=confidence)
        if gamma is not None:
            if not abs(gamma) < float("inf"):
                raise InputError(f"gamma {gamma}: give a finite number")
            found = replace(found, gamma=gamma)
        return found

    def _progress(self) -> dict[str, Progress]:
        return self._hub.call(_progress).result()

    def _view(self, row: JobRow, progress: dict[str, Progress]) -> JobView:
        rollouts, leases, refusals, disputed = progress.get(row.id, (None, 0, {}, False))
        job = row.job
        return JobView(row.id, row.number, row.label, job.scenario.name, job.ego, job.gamma,
                       measure_kind(job.scenario.safety.measure).unit, job.method, job.options,
                       job.seed, row.priority, row.weight, row.at, row.status, row.reason, rollouts, leases,
                       refusals, job.scenario.safety.measure, job.scenario.drivers.noise_mode,
                       disputed, row.max_failed, row.note.text, row.note.tags, row.note.archived)  # fmt: skip


def _progress(scheduler: Scheduler) -> dict[str, Progress]:
    leases: dict[str, int] = {}
    for held in scheduler.workers.leases.values():
        leases[held.key.job] = leases.get(held.key.job, 0) + 1
    return {
        j.id: (j.rollouts, leases.get(j.id, 0), dict(j.refused), scheduler.disputed(j.id))
        for j in scheduler.jobs.values()
    }


def _running(scheduler: Scheduler, worker: WorkerState) -> tuple[RunningChunk, ...]:
    held = [scheduler.workers.leases[lease] for lease in sorted(worker.leases)]
    return tuple(
        RunningChunk(
            job=key.job,
            phase=key.phase,
            iteration=key.iteration,
            rows=key.stop - key.start,
            audit=h.audit,
            for_s=round(scheduler.now - h.since, 1),
        )
        for h in held
        for key in (h.key,)
    )


def _workers(scheduler: Scheduler) -> list[WorkerView]:
    known = scheduler.workers
    here = [
        WorkerView(w.id, c.procs, c.egos, c.camera, c.gpu, c.host, c.versions, len(w.leases), w.chunks, w.rollouts,
                   w.worker_s, now=_running(scheduler, w))
        for w in known.here.values()
        for c in (w.capabilities,)
    ]  # fmt: skip
    return here + [WorkerView(name, quarantine=why) for name, why in known.quarantined.items()]
