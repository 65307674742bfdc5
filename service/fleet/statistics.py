"""The jobs' algorithms at work for the hub: a job is opened from its record, takes in a batch, is asked meanwhile."""

import threading
from collections import OrderedDict

from service.fleet.errors import NoSuchJob
from service.fleet.turns import ReadChunks, Replay, Turn, next_turn, open_turn
from service.job import Problem
from service.store.jobs import JobStore

KEPT = 8  # jobs that are over and still at hand


class Statistics:
    """Problems and last turns of jobs; may be called from any thread."""

    def __init__(self, store: JobStore):
        self._store = store
        self._lock = threading.Lock()
        self._opening: dict[str, threading.Lock] = {}
        self._problems: dict[str, Problem] = {}
        self._turns: dict[str, Turn] = {}
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
        """The job's problem and its last turn; a job that is over is replayed."""
        problem = self.problem(job)
        with self._lock:
            turn = self._turns.get(job)
            opening = self._opening.setdefault(job, threading.Lock())
        if turn is not None:
            return problem, turn
        with opening:  # a long record is replayed once for all who ask
            with self._lock:
                turn = self._turns.get(job)
            if turn is None:
                turn = self.open(job)[1].turn
                self.forget(job)  # it is over, else its turn would be here
        with self._lock:
            self._opening.pop(job, None)
        return problem, turn

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

    def _keep(self, job: str, epoch: int, replay: Replay) -> None:
        if replay.stale:
            self._store.void(job, replay.stale, epoch, "of rows that the job does not have any more")
        with self._lock:
            self._turns[job] = replay.turn
