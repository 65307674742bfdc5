"""The jobs' algorithms at work for the hub: a job is opened from its record, takes in a batch, is asked meanwhile.

What a job that is over has come to is kept in the database, too: when the service has begun anew, its record need not
be replayed, which takes minutes for a million rollouts. It follows from the record: to lose it costs time alone.
"""

import logging
import threading
from collections import OrderedDict

from ce import StateError
from service.errors import StoreError
from service.evaluation.job import Problem
from service.evaluation.store.jobs import JobStore
from service.remote.fleet.errors import NoSuchJob
from service.remote.fleet.turns import ReadChunks, Replay, Turn, next_turn, open_turn

KEPT = 8  # jobs that are over and still at hand
MOST_BYTES = 250_000_000  # of a state in the database; what is larger is replayed

log = logging.getLogger("tailroad.statistics")


class Statistics:
    """Problems and last turns of jobs; may be called from any thread."""

    def __init__(self, store: JobStore):
        self._store = store
        self._lock = threading.Lock()
        self._opening: dict[str, threading.Lock] = {}
        self._problems: dict[str, Problem] = {}
        self._turns: dict[str, Turn] = {}
        self._epochs: dict[str, int] = {}  # of the turns
        self._over: OrderedDict[str, None] = OrderedDict()

    def problem(self, job: str) -> Problem:
        """The job's problem; NoSuchJob for a job that there is not."""
        with self._lock:
            if job in self._problems:
                return self._problems[job]
        row = self._store.job(job)
        if row is None:
            raise NoSuchJob(job)
        problem = Problem(row.job)
        with self._lock:
            return self._problems.setdefault(job, problem)

    def open(self, job: str) -> tuple[int, Replay]:
        """Replay the job's record; its epoch, and where the record takes it."""
        problem, epoch = self.problem(job), self._store.epoch(job)
        replay = open_turn(problem.algorithm, problem.stream_seed, epoch, self._reader(job))
        self._keep(job, epoch, replay)
        return epoch, replay

    def step(self, job: str, turn: Turn) -> Replay:
        """Take in the turn's batch."""
        problem, epoch = self.problem(job), self._store.epoch(job)
        replay = next_turn(problem.algorithm, turn, epoch, self._reader(job))
        self._keep(job, epoch, replay)
        return replay

    def _reader(self, job: str) -> ReadChunks:
        return lambda phase, iteration, start, stop: self._store.chunks.chunks(
            job, phase, iteration, start, stop
        )

    def at_hand(self, job: str) -> bool:
        """Whether `last` answers at once."""
        with self._lock:
            return job in self._turns

    def last(self, job: str) -> tuple[Problem, Turn]:
        """The job's problem and its last turn; of a job that is over as it was kept, else replayed."""
        problem = self.problem(job)
        with self._lock:
            turn = self._turns.get(job)
            opening = self._opening.setdefault(job, threading.Lock())
        if turn is not None:
            return problem, turn
        with opening:  # a long record is replayed once for all who ask
            with self._lock:
                turn = self._turns.get(job)
            if turn is None:  # it is over, else its turn would be here
                turn = self._kept(problem, job) or self._replayed(problem, job)
                self.forget(job)
        with self._lock:
            self._opening.pop(job, None)
        return problem, turn

    def keep(self, job: str) -> None:
        """Write down what a job that is done has come to, where it is still at hand."""
        with self._lock:
            turn, problem, epoch = self._turns.get(job), self._problems.get(job), self._epochs.get(job, 0)
        if turn is not None and problem is not None and turn.batch is None:  # else it was taken up again
            self._write_down(problem, job, epoch, turn)

    def _kept(self, problem: Problem, job: str) -> Turn | None:
        kept = self._store.kept_state(job)
        if kept is None:
            return None
        epoch, number, data = kept
        try:
            turn = Turn(number, problem.algorithm.from_bytes(data), None)
        except StateError as error:
            log.warning("job %s: what was kept of it cannot be used, it is replayed: %s", job, error)
            return None
        with self._lock:
            self._turns[job], self._epochs[job] = turn, epoch
        return turn

    def _replayed(self, problem: Problem, job: str) -> Turn:
        epoch, replay = self.open(job)
        self._write_down(problem, job, epoch, replay.turn)
        return replay.turn

    def _write_down(self, problem: Problem, job: str, epoch: int, turn: Turn) -> None:
        data = problem.algorithm.to_bytes(turn.state)
        if len(data) > MOST_BYTES:
            return
        try:
            self._store.keep_state(job, epoch, turn.number, data)
        except StoreError as error:
            log.warning("job %s: %s; its record will be replayed", job, error)

    def forget(self, job: str) -> None:
        """The job is over: its state, without its batch, is kept for a while, and then read from the record again when
        it is asked for."""
        with self._lock:
            if (turn := self._turns.get(job)) is not None:
                self._turns[job] = Turn(turn.number, turn.state, None)
            self._over[job] = None
            self._over.move_to_end(job)
            while len(self._over) > KEPT:
                old, _ = self._over.popitem(last=False)
                self._problems.pop(old, None)
                self._turns.pop(old, None)
                self._epochs.pop(old, None)

    def _keep(self, job: str, epoch: int, replay: Replay) -> None:
        if replay.stale:
            self._store.void(job, replay.stale, epoch, "of rows that the job does not have any more")
        with self._lock:
            self._turns[job], self._epochs[job] = replay.turn, epoch
