"""The jobs' algorithms at work for the hub: a job is opened from its record, takes in a batch, is asked meanwhile.

Where an open job stands is the hub's to say, by `open` and `step`. Whoever asks for a job that the hub does not have at
work gets what its record comes to, and changes nothing: whether the job is over is told by the database, never by what
happens to be in memory. What a job that is over has come to is kept in the database, too, so that its record need not
be replayed when the service has begun anew; that state is used only where it is of the record as it is now.
"""

import logging
import threading
from collections import OrderedDict
from dataclasses import dataclass, replace

from ce import StateError
from ce.errors import CeError
from service.errors import StoreError, TailroadError
from service.evaluation.job import Problem
from service.evaluation.store import Chunk, Origin
from service.evaluation.store.jobs import JobStore, Mark
from service.evaluation.store.states import KeptState, LastState
from service.remote.fleet.batch_step import BatchStep, ReadChunks, Replay, next_step, open_step
from service.remote.fleet.errors import NoSuchJob

KEPT = 8  # jobs that the hub does not have at work and whose states are still in memory
MOST_BYTES = 250_000_000  # of a state in the database; what is larger is replayed

log = logging.getLogger("tailroad.statistics")


class Stopping(StoreError):
    """The service stops while a record is being replayed."""

    def __init__(self) -> None:
        super().__init__("the service stops")


@dataclass(frozen=True)
class _Read:
    """The last step, without its batch, of a job that the hub does not have at work.

    finished: the algorithm has nothing left to propose
    mark: of the record that the step is of, None where the hub has left it here: then it is finished, and nothing but
        a new epoch changes it
    """

    step: BatchStep
    epoch: int
    finished: bool
    mark: Mark | None

    def is_of(self, mark: Mark) -> bool:
        return self.epoch == mark.epoch and (self.finished or self.mark == mark)


class Statistics:
    """Problems and last steps of jobs; may be called from any thread."""

    def __init__(self, store: JobStore):
        self._store = store
        self._lock = threading.Lock()
        self._reading: dict[str, threading.Lock] = {}  # a long record is replayed once for all who ask
        self._problems: OrderedDict[str, Problem] = OrderedDict()
        self._open: dict[str, tuple[int, BatchStep]] = {}  # at work: epoch and step
        self._read: OrderedDict[str, _Read] = OrderedDict()
        self._stopping = threading.Event()

    def problem(self, job: str) -> Problem:
        """The job's problem; NoSuchJob for a job that there is not."""
        with self._lock:
            if job in self._problems:
                self._problems.move_to_end(job)
                return self._problems[job]
        row = self._store.job(job)
        if row is None:
            raise NoSuchJob(job)
        begun = self._store.beginnings.of(job)
        if begun is not None and (other := begun.differs_from(row.job)):
            raise StoreError(
                f"the database says {other.path} = {other.now} of job {job}, and it was begun with {other.path} = "
                f"{other.then}: what it came to is not told; put it back, or take the database from a copy"
            )
        problem = Problem(row.job)
        with self._lock:
            problem = self._problems.setdefault(job, problem)
            others = [name for name in self._problems if name != job and name not in self._open]
            for name in others[: max(len(others) - KEPT, 0)]:
                del self._problems[name]
        return problem

    def stop(self) -> None:
        """End what is being replayed: `Stopping` is raised where that is."""
        self._stopping.set()

    # -- for the hub -----------------------------------------------------------------------------------------

    def open(self, job: str) -> tuple[int, Replay]:
        """Replay the job's record; its epoch, and where the record takes it."""
        problem, epoch = self.problem(job), self._store.epoch(job)
        replay = open_step(problem.algorithm, problem.stream_seed, epoch, self._reader(job))
        self._enter(job, epoch, replay)
        return epoch, replay

    def step(self, job: str, step: BatchStep) -> Replay:
        """Take in the step's batch."""
        problem, epoch = self.problem(job), self._store.epoch(job)
        replay = next_step(problem.algorithm, step, epoch, self._reader(job))
        self._enter(job, epoch, replay)
        return replay

    def _enter(self, job: str, epoch: int, replay: Replay) -> None:
        if replay.stale:
            self._store.void(job, replay.stale, epoch, "of rows that the job does not have any more")
        with self._lock:
            known_epoch, known = self._open.get(job, (-1, replay.step))
            if epoch > known_epoch or (epoch == known_epoch and replay.step.number >= known.number):
                self._open[job] = epoch, replay.step  # else it is an answer to a question of before

    def end(self, job: str) -> None:
        """The hub has the job at work no more. What it has finished is kept for a while; what it has not is read from
        the record when it is asked for."""
        with self._lock:
            epoch, step = self._open.pop(job, (0, None))
            if step is not None and step.batch is None:
                self._remember(job, _Read(step, epoch, True, None))

    def keep(self, job: str) -> None:
        """Write down what a job that is done has come to, where it is still at hand."""
        with self._lock:
            known = self._read.get(job)
        mark = self._store.mark(job)
        if known is not None and known.finished and mark.over and known.epoch == mark.epoch:
            # if chunks are voided now, the epoch is not the present one
            record = self._store.chunks.digest(job)
            self._write_down(self.problem(job), job, known.epoch, record, known.step)

    # -- for whoever asks ------------------------------------------------------------------------------------

    def at_hand(self, job: str) -> bool:
        """Whether `last` answers at once."""
        with self._lock:
            if job in self._open:
                return True
            known = self._read.get(job)
        return known is not None and known.is_of(self._store.mark(job))

    def last(self, job: str) -> tuple[Problem, BatchStep]:
        """The job's problem and its last step: the hub's where that has the job at work, else what its record comes
        to."""
        problem = self.problem(job)
        with self._lock:
            if job in self._open:
                return problem, self._open[job][1]
            reading = self._reading.setdefault(job, threading.Lock())
        with reading:
            step = self._from_record(problem, job)
        with self._lock:
            self._reading.pop(job, None)
        return problem, step

    def heal(self) -> None:
        """Make sound the states that were kept before there were checksums: each is compared with what the job's chunks
        come to, and replaced. A wrong one is told of in the log."""
        for job in self._store.states.without_checksum():
            try:
                self.last(job)
            except (TailroadError, CeError, ValueError, OSError) as error:
                if self._stopping.is_set():
                    return
                log.warning("job %s: the state kept of it cannot be checked, and is not used: %s", job, error)

    def _from_record(self, problem: Problem, job: str) -> BatchStep:
        while True:
            mark = self._store.mark(job)
            with self._lock:
                if job in self._open:
                    return self._open[job][1]
                known = self._read.get(job)
            if known is None or not known.is_of(mark):
                try:
                    known = (self._ended if mark.over else self._replayed)(problem, job, mark)
                except StoreError:
                    if self._store.mark(job).epoch == mark.epoch:
                        raise
                    continue  # chunks were voided meanwhile: what was read was of two epochs
            with self._lock:
                self._remember(job, known)
            return known.step

    def _replayed(self, problem: Problem, job: str, mark: Mark) -> _Read:
        """As far as the record goes; nothing is changed in it."""
        replay = open_step(problem.algorithm, problem.stream_seed, mark.epoch, self._reader(job))
        return _Read(replay.step, mark.epoch, replay.step.batch is None, mark)

    def _ended(self, problem: Problem, job: str, mark: Mark) -> _Read:
        """Of a job that is over: its kept state where that is of the record, else replayed, and kept."""
        record = self._store.chunks.digest(job)
        kept = self._store.states.kept(job, mark.epoch)
        wrong = self._wrong(kept, mark, record) if kept is not None else ""
        unreadable = None
        if kept is not None and not wrong:
            try:
                state = problem.algorithm.from_bytes(kept.last.state)
                return _Read(
                    BatchStep(kept.last.number, state, None), mark.epoch, mark.status == "done", mark
                )
            except StateError as error:
                wrong, unreadable = str(error), kept.last.state
        read = self._replayed(problem, job, mark)
        self._write_down(problem, job, mark.epoch, record, read.step, unreadable)
        if kept is not None:
            _log_healed(job, kept, wrong, read.step.number, problem.algorithm.to_bytes(read.step.state))
        return read

    def _wrong(self, kept: KeptState, mark: Mark, record: str) -> str:
        """Why a kept state is not to be used, "" for one that is."""
        if not kept.sound:
            return "it has no checksum that holds"
        if kept.last.record != record:
            return "it is not of the job's record"
        batches = self._store.batches(kept.last.job, kept.last.epoch)
        if mark.status == "done" and kept.last.number != batches:
            return f"it is of {kept.last.number} batches, and the job has {batches}"
        return ""

    def _write_down(
        self,
        problem: Problem,
        job: str,
        epoch: int,
        record: str,
        step: BatchStep,
        unreadable: bytes | None = None,
    ) -> None:
        data = problem.algorithm.to_bytes(step.state)
        if len(data) > MOST_BYTES:
            return
        try:
            self._store.states.keep(LastState(job, epoch, step.number, record, data), unreadable)
        except StoreError as error:
            log.warning("job %s: %s; its record will be replayed", job, error)

    def _remember(self, job: str, read: _Read) -> None:
        """Under the lock."""
        self._read[job] = replace(read, step=BatchStep(read.step.number, read.step.state, None))
        self._read.move_to_end(job)
        while len(self._read) > KEPT:
            self._read.popitem(last=False)

    def _reader(self, job: str) -> ReadChunks:
        def read(phase: str, iteration: int, start: int, stop: int) -> list[tuple[Chunk, Origin]]:
            if self._stopping.is_set():
                raise Stopping
            return self._store.chunks.chunks(job, phase, iteration, start, stop)

        return read


def _log_healed(job: str, kept: KeptState, wrong: str, batches: int, state: bytes) -> None:
    """What a kept state said that was not used, beside what the job's chunks come to."""
    if (kept.last.number, kept.last.state) == (batches, state):
        log.info("job %s: the state kept of it is what its record comes to; it has its checksum now", job)
        return
    log.warning(
        "job %s: the state kept of it (after %d batches) was not used, as %s; it is made again from the job's chunks "
        "(after %d batches)",
        job,
        kept.last.number,
        wrong,
        batches,
    )
