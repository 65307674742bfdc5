"""The hub: one thread that feeds the scheduler what happens and carries out what it answers.

Answers are recorded in groups, one transaction for all that came in together (`service.remote.fleet.writes`).
"""

import logging
import queue
import secrets
import threading
import time
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, TypeVar

from service.errors import StoreError, StoreOutage, TailroadError
from service.evaluation.store.jobs import Event, JobRow, JobStore
from service.remote.fleet import events as E
from service.remote.fleet.answers import chunk_of
from service.remote.fleet.elapsed import Elapsed
from service.remote.fleet.messages import (
    Answer,
    BadMessage,
    GetJob,
    JobSpec,
    Lease,
    Refused,
    Reply,
    decode_request,
    encode,
)
from service.remote.fleet.outage import while_out
from service.remote.fleet.peers import NOBODY, Peer
from service.remote.fleet.policy import STANDARD, Policy
from service.remote.fleet.referee import Referee
from service.remote.fleet.scheduler import Scheduler
from service.remote.fleet.statistics import Statistics, Stopping
from service.remote.fleet.stock import held_bytes_of, take_stock
from service.remote.fleet.versions import digests, versions
from service.remote.fleet.writes import Writes
from service.world.egos.open import REMOTE

TICK_S = 0.25
GROUP = 512  # events that are taken together

log = logging.getLogger("tailroad.hub")
T = TypeVar("T")


@dataclass(frozen=True)
class _Call:
    """Something to be done in the hub's thread."""

    run: Callable[[Scheduler], Any]
    result: Future


class Hub:
    """The scheduler at work. Methods may be called from any thread; `listen` functions are called in the hub's."""

    def __init__(
        self,
        store: JobStore,
        policy: Policy = STANDARD,
        clock: Callable[[], float] = time.monotonic,
        made_of: dict[str, str] | None = None,
        statistics_threads: int = 2,
        on_death: Callable[[], None] = lambda: None,
        referee: Referee | None = None,
    ):
        """Make a hub that waits for `start`.

        on_death: called where its thread ends by an error that nobody foresaw
        referee: who settles disputes, in place of a process of this machine
        """
        self.store = store
        self.statistics = Statistics(store)
        self._time = Elapsed(clock)
        self._scheduler = Scheduler(
            made_of or versions(), policy, store.quarantined(), secrets.token_bytes(16)
        )
        self._inbox: queue.SimpleQueue[E.Event | _Call | None] = queue.SimpleQueue()
        self._requests: dict[int, Callable[[bytes], None]] = {}
        self._last_request = 0
        self._request_lock = threading.Lock()
        self._writes = Writes(store, self._time.now, self._handle, self._publish, self._over, self.take_up)
        self._listeners: list[Callable[[Event], None]] = []
        self._pool = ThreadPoolExecutor(statistics_threads, thread_name_prefix="statistics")
        self._thread = threading.Thread(target=self._run, name="hub")
        self._healing = threading.Thread(target=self._heal, name="healing")
        self._referee = referee or Referee()
        self._stopping = False
        self._on_death = on_death
        self._dead = False

    # -- from outside ----------------------------------------------------------------------------------------

    def start(self) -> None:
        """Take up every job of the database that is not over, and go."""
        if old := self.store.chunks.without_checksum():
            log.warning("%d chunks were recorded before there were checksums; they are read as they are", old)
        for row in take_stock(self.store):
            self.take_up(row)
        self._thread.start()
        self._healing.start()

    def stop(self) -> None:
        """End the thread; what is in the database is all that a new hub needs."""
        self._stopping = True
        self._inbox.put(None)
        self._thread.join()
        self.statistics.stop()
        self._healing.join()
        self._referee.close()
        self._pool.shutdown(wait=True, cancel_futures=True)

    def take_up(self, row: JobRow) -> None:
        """Have a job of the database run."""
        ego = row.job.ego
        own = not ego.startswith(REMOTE)  # a black box may answer late on one worker and not on another
        paused = row.status == "paused"
        self.post(
            E.Submitted(
                row.id, ego, row.priority, row.weight, paused, own, held_bytes_of(row), row.max_failed
            )
        )

    def post(self, event: E.Event) -> None:
        self._inbox.put(event)

    def call(self, run: Callable[[Scheduler], T]) -> "Future[T]":
        """Look at the scheduler in the hub's thread; be quick, and change nothing."""
        result: Future[T] = Future()
        self._inbox.put(_Call(run, result))
        if self._dead:
            self._refuse_calls()
        return result

    def listen(self, listener: Callable[[Event], None]) -> None:
        """Be told what jobs tell."""
        self._listeners.append(listener)

    def gone(self, worker: str) -> None:
        self.post(E.Gone(worker))

    def receive(
        self, worker: str, kind: str, data: bytes, answer: Callable[[bytes], None], peer: Peer = NOBODY
    ) -> None:
        """A message of `worker`, over the connection of `peer`; `answer` is called once with the reply, at once or
        later."""
        try:
            message = decode_request(data)
            if message.worker != worker:
                raise BadMessage(f"the message is signed {message.worker!r}")
            chunk = chunk_of(message) if isinstance(message, Answer) else None
        except BadMessage as error:
            log.warning("worker %s, %s: %s", worker, kind, error)
            self.post(E.Garbled(worker, str(error), peer))
            answer(encode(Refused(str(error))))
            return
        if isinstance(message, GetJob):
            self._pool.submit(self._send_job, message.job, answer)
            return
        with self._request_lock:
            self._last_request += 1
            number = self._last_request
            self._requests[number] = answer
        self.post(E.Requested(number, message, chunk, peer))

    def _send_job(self, job: str, answer: Callable[[bytes], None]) -> None:
        reply: Reply
        try:
            reply = self._spec(job)
        except StoreError as error:
            reply = Refused(str(error), again=True)
        except (TailroadError, ValueError, OSError) as error:
            reply = Refused(str(error))
        answer(encode(reply))

    def _spec(self, job: str) -> JobSpec:
        problem = self.statistics.problem(job)
        return JobSpec(job, problem.job, digests(problem))

    # -- the thread ------------------------------------------------------------------------------------------

    def _run(self) -> None:
        try:
            self._work()
        except BaseException:
            # a panic of Zenoh's is no Exception; without this thread the service only looks alive
            log.critical(
                "the scheduler ends: what is in the database goes on at the next start", exc_info=True
            )
            self._dead = True
            self._refuse_calls()
            self._on_death()
            raise

    def _refuse_calls(self) -> None:
        """Whoever waits for a thread that is no more is told."""
        with suppress(queue.Empty):
            while True:
                waiting = self._inbox.get_nowait()
                if isinstance(waiting, _Call):
                    waiting.result.set_exception(
                        StoreError("the scheduler has ended; start the service again")
                    )

    def _work(self) -> None:
        next_tick = self._time.now()
        while not self._stopping:
            for event in self._collect():
                if isinstance(event, _Call):
                    self._look(event)
                elif event is not None:
                    self._handle(event)
            if not self._stopping and self._time.now() >= next_tick:
                next_tick = self._time.now() + TICK_S
                self._handle(E.Tick())
            self._writes.carry_out()

    def _collect(self) -> list[E.Event | _Call | None]:
        found: list[E.Event | _Call | None] = []
        with suppress(queue.Empty):
            found.append(self._inbox.get(timeout=TICK_S))
            while len(found) < GROUP:
                found.append(self._inbox.get_nowait())
        return found

    def _look(self, call: _Call) -> None:
        try:
            call.result.set_result(call.run(self._scheduler))
        except Exception as error:  # it is the caller's, whose thread waits for it
            call.result.set_exception(error)

    def _handle(self, event: E.Event) -> None:
        for instruction in self._scheduler.handle(self._time.now(), event):
            self._do(instruction)
        if isinstance(event, E.Opened | E.Stepped) and not self._is_open(event.job):
            self.statistics.end(event.job)  # it was over before this came

    def _is_open(self, job: str) -> bool:
        """From any thread."""
        return job in self._scheduler.jobs

    def _do(self, instruction: E.Instruction) -> None:
        match instruction:
            case E.Send():
                answer = self._requests.pop(instruction.request)
                answer(encode(instruction.reply))
            case E.Open():
                self._pool.submit(self._open, instruction)
            case E.Step():
                self._pool.submit(self._step, instruction)
            case E.Settle():
                self._pool.submit(self._settle, instruction)
            case E.Publish(kept=False):
                self._publish(Event(instruction.job, 0, instruction.kind, instruction.body, ""))
            case _:
                self._writes.add(instruction)

    def _publish(self, event: Event) -> None:
        for listener in self._listeners:
            listener(event)

    # -- statistics, in their own threads --------------------------------------------------------------------

    def _open(self, instruction: E.Open) -> None:
        job, generation = instruction.job, instruction.generation
        if self._is_open(job) and (found := self._come_to(instruction, lambda: self.statistics.open(job))):
            self.post(E.Opened(job, generation, *found))

    def _step(self, instruction: E.Step) -> None:
        job, generation = instruction.job, instruction.generation
        replay = self._come_to(instruction, lambda: self.statistics.step(job, instruction.step))
        if replay is not None:
            self.post(E.Stepped(job, generation, replay))

    def _come_to(self, instruction: E.Open | E.Step, run: Callable[[], T]) -> T | None:
        """What the statistics of a job come to; None where the hub stops, and where they fail, which ends the job."""
        try:
            return while_out(run, lambda: self._stopping)
        except (Stopping, StoreOutage):  # it stops
            return None
        except Exception as error:  # whatever it is, it is the job's end and nobody else's
            log.exception("job %s: %s failed", instruction.job, type(instruction).__name__)
            self.post(E.Broken(instruction.job, instruction.generation, f"{type(error).__name__}: {error}"))
            return None

    def _settle(self, instruction: E.Settle) -> None:
        key = instruction.key
        try:
            found = self._referee.replay(
                self._spec(key.job), Lease(0, key, instruction.rows, instruction.limit_s)
            )
        except (TailroadError, ValueError, OSError) as error:
            found = str(error)
        if isinstance(found, str):
            log.warning("job %s: a dispute cannot be settled here: %s", key.job, found)
            self.post(E.Settled(key, None, found))
        else:
            self.post(E.Settled(key, found.fingerprint()))

    def _over(self, job: str, status: str) -> None:
        self.statistics.end(job)
        if status == "done" and not self._stopping:
            self._pool.submit(self._keep, job)

    def _keep(self, job: str) -> None:
        try:
            self.statistics.keep(job)
        except Exception:  # it only spares a replay
            log.exception("what job %s came to is not kept", job)

    def _heal(self) -> None:
        try:
            self.statistics.heal()
        except Exception:  # states without a checksum are not used, with or without this
            log.exception("the kept states of earlier jobs are not checked")
