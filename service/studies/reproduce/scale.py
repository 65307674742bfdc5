"""How far one scheduler reaches: the real state machine, messages and statistics, workers in virtual time.

What takes time is what takes it in a fleet. Rollouts: times measured here, drawn again with replacement.
Drawing the rows at the worker and at the scheduler, the scheduler's decisions, packing and unpacking
messages: done for real, by their processor time. The network: LATENCY_S each way. Audits and copies of
stragglers count as what they cost. The scheduler is one server with a queue, statistics another, as in
`service.remote.fleet.hub`. The database and Zenoh's own work are left out but for MESSAGE_S a message.
"""

import heapq
import itertools
import time
from collections.abc import Callable
from functools import partial
from typing import Any

import msgspec
import numpy as np

import ce
from service.evaluation.job import Job, Problem
from service.evaluation.store import Chunk
from service.remote.fleet import events as E
from service.remote.fleet.answers import answer_of, chunk_of
from service.remote.fleet.batch_step import next_step, open_step
from service.remote.fleet.messages import (
    Answer,
    Ask,
    Capabilities,
    GetJob,
    Hello,
    Lease,
    Nothing,
    Welcome,
    decode_request,
    encode,
)
from service.remote.fleet.policy import STANDARD, Policy
from service.remote.fleet.scheduler import Scheduler

LATENCY_S = 0.00025  # one way; a query through a router and back takes 0.5 ms (measured)
MESSAGE_S = 0.0002  # of the scheduler's process, for Zenoh and the database
TICK_S = 0.1
EGO = "lidar"


class FleetTiming(msgspec.Struct, frozen=True, kw_only=True):
    """What a fleet of so many workers came to.

    efficiency: the job's rollouts' own time over workers x makespan
    busy: share of the makespan that the scheduler and the statistics were busy for
    """

    workers: int
    rollouts: int
    rollout_ms: float
    makespan_s: float
    rollouts_per_s: float
    efficiency: float
    scheduler_busy: float
    statistics_busy: float
    chunks: int
    scheduler_ms_per_chunk: float


def measure(job: Job, rollouts: int) -> np.ndarray:
    """Processor time of rollouts of the job in SUMO, each, s; without the first, which compiles."""
    problem = Problem(job)
    x, noise_seeds = ce.draw(problem.base, problem.stream_seed, "estimate", 0, 0, rollouts + 1)
    taken = np.empty(rollouts + 1)
    with problem.simulator() as simulator:
        for i, (row, seed) in enumerate(zip(x, noise_seeds, strict=True)):
            began = time.process_time()
            simulator.run(row, int(seed))
            taken[i] = time.process_time() - began
    return taken[1:]


def play(job: Job, rollout_s: np.ndarray, workers: int, policy: Policy = STANDARD) -> FleetTiming:
    """Run the job to its end on so many workers of one process each, in virtual time."""
    return _Fleet(job, rollout_s, workers, policy).run()


class _Fleet:
    def __init__(self, job: Job, rollout_s: np.ndarray, workers: int, policy: Policy):
        self._problem = Problem(job)
        self._algorithm = self._problem.algorithm
        self._rollout_s = rollout_s
        self._workers = workers
        self._scheduler = Scheduler({}, policy)
        self._heap: list[tuple[float, int, Callable[[float], None]]] = []
        self._order = itertools.count()
        self._requests: dict[int, tuple[str, Callable[[float, Any], None]]] = {}
        self._numbers = itertools.count(1)
        self._random = np.random.default_rng(0)
        self._free_at = 0.0  # the scheduler
        self._free_statistics_at = 0.0
        self._busy = self._busy_statistics = 0.0
        self._chunks = 0
        self._done_at: float | None = None
        self._draw_s = self._time_of_draws()

    def _time_of_draws(self) -> float:
        """What a worker takes to draw the rows of a chunk, s."""
        began = time.process_time()
        for k in range(3):
            ce.draw(self._problem.base, 1, "estimate", 0, 100 * k, 100 * (k + 1))
        return (time.process_time() - began) / 3

    def run(self) -> FleetTiming:
        self._at(0.0, lambda now: self._handle(now, E.Submitted("job", EGO)))
        for i in range(self._workers):
            self._at(0.0, partial(self._begin, f"w{i}"))
        self._at(TICK_S, self._tick)
        while self._done_at is None:
            now, _, happen = heapq.heappop(self._heap)
            happen(now)
        span, mean_s = self._done_at, float(self._rollout_s.mean())
        # audits and copies are not among them: they are what they cost
        rollouts = self._algorithm.total_rollouts
        return FleetTiming(
            workers=self._workers,
            rollouts=rollouts,
            rollout_ms=1e3 * mean_s,
            makespan_s=span,
            rollouts_per_s=rollouts / span,
            efficiency=rollouts * mean_s / (self._workers * span),
            scheduler_busy=self._busy / span,
            statistics_busy=self._busy_statistics / span,
            chunks=self._chunks,
            scheduler_ms_per_chunk=1e3 * self._busy / max(self._chunks, 1),
        )

    def _at(self, when: float, happen: Callable[[float], None]) -> None:
        heapq.heappush(self._heap, (when, next(self._order), happen))

    # -- the scheduler, a server with a queue ----------------------------------------------------------------

    def _handle(self, now: float, event: E.Event, prepare_s: float = 0.0) -> None:
        start = max(now, self._free_at)
        began = time.thread_time()
        instructions = self._scheduler.handle(start, event)
        replies = [(i, encode(i.reply)) for i in instructions if isinstance(i, E.Send)]
        taken = time.thread_time() - began + prepare_s
        self._busy += taken
        self._free_at = start + taken
        for instruction, _ in replies:
            _, hear = self._requests.pop(instruction.request)
            self._at(self._free_at + LATENCY_S, partial(_heard, hear, instruction.reply))
        for other in instructions:
            self._do(other)

    def _do(self, instruction: E.Instruction) -> None:
        if isinstance(instruction, E.Open):
            opened = instruction
            self._compute(
                lambda: E.Opened(
                    "job",
                    opened.generation,
                    0,
                    open_step(self._algorithm, self._problem.stream_seed, 0, _nothing),
                )
            )
        elif isinstance(instruction, E.Step):
            step = instruction
            self._compute(
                lambda: E.Stepped("job", step.generation, next_step(self._algorithm, step.step, 0, _nothing))
            )
        elif isinstance(instruction, E.Record):
            ticket = instruction.ticket
            self._at(self._free_at, lambda t: self._handle(t, E.Recorded((ticket,))))
        elif isinstance(instruction, E.SetStatus) and instruction.status == "done":
            self._done_at = self._free_at

    def _compute(self, work: Callable[[], E.Event]) -> None:
        """Statistics, in their own thread."""
        start = max(self._free_at, self._free_statistics_at)
        began = time.thread_time()
        event = work()
        taken = time.thread_time() - began
        self._busy_statistics += taken
        self._free_statistics_at = start + taken
        self._at(self._free_statistics_at, lambda t: self._handle(t, event))

    def _tick(self, now: float) -> None:
        self._handle(now, E.Tick())
        self._at(now + TICK_S, self._tick)

    def _say(self, now: float, message: Any, hear: Callable[[float, Any], None]) -> None:
        """A worker's message, packed by it, unpacked and answered by the scheduler."""
        data = encode(message)

        def arrive(t: float) -> None:
            began = time.thread_time()
            read = decode_request(data)
            assert not isinstance(read, GetJob)
            chunk = chunk_of(read) if isinstance(read, Answer) else None
            number = next(self._numbers)
            self._requests[number] = (message.worker, hear)
            self._handle(t, E.Requested(number, read, chunk), time.thread_time() - began + MESSAGE_S)

        self._at(now + LATENCY_S, arrive)

    # -- the workers -----------------------------------------------------------------------------------------

    def _begin(self, name: str, now: float) -> None:
        self._say(now, Hello(name, Capabilities(1, (EGO,), False, False, {})), self._welcomed(name))

    def _welcomed(self, name: str) -> Callable[[float, Any], None]:
        def hear(now: float, reply: Any) -> None:
            assert isinstance(reply, Welcome), reply
            self._ask(now, name)

        return hear

    def _ask(self, now: float, name: str) -> None:
        self._say(now, Ask(name, 0, "job"), lambda t, reply: self._told(t, name, reply))

    def _told(self, now: float, name: str, reply: Any) -> None:
        if isinstance(reply, Nothing):
            self._ask(now, name)
        elif isinstance(reply, Lease):
            n = reply.chunk.stop - reply.chunk.start
            own = float(self._random.choice(self._rollout_s, n).sum())
            self._chunks += 1
            self._at(now + own + self._draw_s, lambda t: self._answer(t, name, reply, own))

    def _answer(self, now: float, name: str, lease: Lease, own_s: float) -> None:
        key = lease.chunk
        n = key.stop - key.start
        # the same whoever answers: chunks are audited
        f = 1.0 + np.arange(key.start, key.stop) % 1000 / 1000.0
        chunk = Chunk(key.start, key.stop, f, np.zeros(n, np.uint8), np.full(n, 100, np.int32), {}, own_s)

        def noted(t: float, reply: Any) -> None:
            pass

        self._say(now, answer_of(name, lease.lease, key, chunk), noted)
        self._ask(now, name)


def _heard(hear: Callable[[float, Any], None], reply: Any, now: float) -> None:
    hear(now, reply)


def _nothing(phase: str, iteration: int, start: int, stop: int) -> list:
    return []
