"""A fleet without processes, network or disk: the scheduler, a record in memory, and workers that compute a formula.

Everything that is under way (a reply, an answer, an instruction) lies in a list until a test delivers it, or loses it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import lru_cache
from types import SimpleNamespace

import msgspec
import numpy as np

import ce
from service.evaluation.evaluate import evaluate
from service.evaluation.store import FAILED, Chunk
from service.evaluation.store.draws import row_hashes, rows_digest
from service.evaluation.store.jobs import OPEN
from service.remote.fleet import events as E
from service.remote.fleet.answers import answer_of, chunk_of
from service.remote.fleet.jobs import NEXT_PHASES
from service.remote.fleet.messages import (
    Answer,
    Ask,
    Capabilities,
    ChunkKey,
    Drawn,
    Hello,
    Lease,
    Refused,
)
from service.remote.fleet.peers import Peer
from service.remote.fleet.policy import Policy
from service.remote.fleet.scheduler import Scheduler
from service.remote.fleet.statistics import Statistics
from tests.service.remote.fleet.memory import MemoryStore, Record

BASE = ce.Product([ce.Beta(2.0, 2.0), ce.Beta(2.0, 3.0)])
VERSIONS = {"tailroad": "1"}
SEED = 5
MOST_ROWS = 1000  # of a stream
ALGORITHMS = {
    "naive": ce.algorithm("naive", BASE, 0.3, ce.NaiveOptions(budget=120, batch_size=50)),
    "ce": ce.algorithm(
        "ce", BASE, 0.1, ce.CrossEntropyOptions(budget=1000, iterations=3, samples_per_iteration=200, rho=0.1)
    ),
    "auto": ce.algorithm("auto", BASE, 0.05, ce.AutoOptions(budget=1200)),
}


def formula(x: np.ndarray, noise_seeds: np.ndarray) -> tuple[np.ndarray, np.ndarray, dict[int, str]]:
    """f, outcomes and errors of rows: what every honest worker comes to."""
    f = x[:, 0] + 0.5 * x[:, 1] + (noise_seeds % 1000) * 1e-5
    failed = noise_seeds % 50 == 0
    f[failed] = np.nan
    outcomes = np.where(failed, FAILED, noise_seeds % 3).astype(np.uint8)
    return f, outcomes, {int(i): "no camera" for i in np.flatnonzero(failed)}


def bits(estimate: ce.Estimate) -> tuple:
    return estimate.p, estimate.std_error, estimate.ci, estimate.rollouts, estimate.f.tobytes()


def reference(method: str) -> tuple:
    """What one process comes to."""
    return bits(evaluate(ALGORITHMS[method], SEED, lambda batch: formula(batch.x, batch.noise)[0]))


class WorldStatistics(Statistics):
    """Of jobs whose algorithms are in ALGORITHMS."""

    def __init__(self, record: Record, jobs: dict[str, str]):
        super().__init__(MemoryStore(record))
        self._methods = jobs

    def problem(self, job: str) -> SimpleNamespace:
        return SimpleNamespace(algorithm=ALGORITHMS[self._methods[job]], stream_seed=SEED)


@dataclass
class Slot:
    worker: str
    number: int
    lease: Lease | None = None
    waiting: bool = False


@dataclass
class World:
    """The fleet of some jobs, by method."""

    jobs: dict[str, str]  # id -> method
    policy: Policy = Policy(first_rows=7, audit_share=0.0)  # noqa: RUF009 (frozen)
    now: float = 0.0
    record: Record = field(default_factory=Record)
    to_keep: list[str] = field(default_factory=list)  # jobs that are done and not written down yet
    instructions: list = field(default_factory=list)  # for the statistics: in any order
    writes: list = field(default_factory=list)  # for the database: in order
    requests: dict[int, Slot | None] = field(default_factory=dict)
    slots: dict[tuple[str, int], Slot] = field(default_factory=dict)
    answers: list[Answer] = field(default_factory=list)  # on their way
    wrong: set[str] = field(default_factory=set)
    referee: bool = True  # whether this machine can run a chunk
    hosts: dict[str, str] = field(default_factory=dict)  # addresses of workers; each its own otherwise
    leased: int = 0
    replies: list = field(default_factory=list)
    reopened: set[str] = field(
        default_factory=set
    )  # jobs that were done, and are running again for a quarantine
    audited: bool = True  # the ego is no black box
    repeated: list[dict] = field(default_factory=list)  # what was told of chunks that were run again

    def __post_init__(self) -> None:
        self.last_request = 0
        self.begin()

    # -- the scheduler's side --------------------------------------------------------------------------------

    def begin(self) -> None:
        """A scheduler, the first one or after a crash: all that is left is the record."""
        self.scheduler = Scheduler(VERSIONS, self.policy, dict(self.record.quarantined))
        self.statistics = WorldStatistics(self.record, self.jobs)
        self.instructions, self.writes, self.requests, self.to_keep = [], [], {}, []
        for slot in self.slots.values():
            slot.waiting = False
        for job in self.jobs:
            status = self.record.statuses.get(job, "running")
            if status in ("running", "paused"):
                self.tell(E.Submitted(job, "idm", 0, 1.0, status == "paused", self.audited, 1))

    def tell(self, event: E.Event) -> None:
        before = {name: (job.phase, job.generation) for name, job in self.scheduler.jobs.items()}
        instructions = self.scheduler.handle(self.now, event)
        for name, (phase, generation) in before.items():
            job = self.scheduler.jobs.get(name)
            if job is not None and (job.phase, job.generation) != (phase, generation):
                assert job.phase in NEXT_PHASES[phase]
        for one in instructions:
            if isinstance(one, E.Send):
                self._reply(self.requests.pop(one.request), one.reply)
            elif isinstance(one, E.Open | E.Step | E.Settle):
                self.instructions.append(one)
            elif not isinstance(one, E.Publish):
                self.writes.append(one)
            elif one.kind == "repeated":
                self.repeated.append(one.body)

    def _reply(self, slot: Slot | None, reply) -> None:
        self.replies.append(reply)
        if slot is not None:
            slot.waiting = False
            if isinstance(reply, Lease):
                self.leased += 1
                slot.lease = reply
            elif isinstance(reply, Refused) and reply.unknown:
                self.hello(slot.worker)

    def compute(self, which: int = 0) -> None:
        """Carry out an instruction for the statistics."""
        one = self.instructions.pop(which)
        if isinstance(one, E.Settle):
            honest = chunk_of(answer(Lease(0, one.key, one.rows, one.limit_s), "referee"))
            self.tell(
                E.Settled(one.key, honest.fingerprint() if self.referee else None, "there is no SUMO here")
            )
            return
        if isinstance(one, E.Open):
            if one.job not in self.scheduler.jobs:
                return
            epoch, replay = self.statistics.open(one.job)
            self.tell(E.Opened(one.job, one.generation, epoch, replay))
        else:
            self.tell(E.Stepped(one.job, one.generation, self.statistics.step(one.job, one.step)))
        if one.job not in self.scheduler.jobs:
            self.statistics.end(one.job)

    def keep(self, which: int = 0) -> None:
        """Write down what a job that is done has come to."""
        self.statistics.keep(self.to_keep.pop(which))

    def read(self, job: str, moment: int = -1, meanwhile: Callable[[], None] = lambda: None) -> tuple:
        """What somebody who asks for the job is told; meanwhile: what happens when its chunks have been read `moment`
        times."""
        left = moment

        def on_read() -> None:
            nonlocal left
            left -= 1
            if left == -1:
                meanwhile()

        self.record.on_read = on_read
        try:
            _, step = self.statistics.last(job)
        finally:
            self.record.on_read = lambda: None
        return bits(ALGORITHMS[self.jobs[job]].estimate(step.state))

    def write(self, heard: bool = True) -> None:
        """Carry out the first thing that waits for the database. heard: False: it was done and its answer was lost, so
        that it is asked for again."""
        one = self.writes[0] if not heard else self.writes.pop(0)
        if isinstance(one, E.Record):
            self.record.append(one)
            if heard:
                self.tell(E.Recorded((one.ticket,)))
        elif isinstance(one, E.SetStatus):
            self.record.statuses[one.job] = one.status
            if heard and one.status not in OPEN:
                self.statistics.end(one.job)
                self.to_keep += [one.job] if one.status == "done" else []
        elif isinstance(one, E.Note):
            known = self.record.batches.get((one.job, one.epoch), 0)
            self.record.batches[one.job, one.epoch] = max(known, one.first + len(one.records))
        elif isinstance(one, E.Confirm):
            self.record.audits.add(msgspec.structs.astuple(one.audit)[:5])
        elif isinstance(one, E.Quarantine):
            jobs = self.record.quarantine(one.worker, one.reason)
            self.record.quarantined |= dict.fromkeys(one.also, one.reason)
            done = [job for job in jobs if self.record.statuses.get(job) == "done"]
            self.record.statuses |= dict.fromkeys(done, "running")  # by the same transaction
            self.reopened |= set(done)
            if heard:
                self.tell(E.Voided(one.worker, jobs))
                for job in sorted(self.reopened & set(jobs)):
                    self.tell(E.Submitted(job, "idm", audited=self.audited, held_bytes=1))

    # -- the workers' side -----------------------------------------------------------------------------------

    def say(self, message, slot: Slot | None = None, chunk: Chunk | None = None) -> None:
        self.last_request += 1
        self.requests[self.last_request] = slot
        host = self.hosts.get(message.worker, f"host-of-{message.worker}")
        self.tell(E.Requested(self.last_request, message, chunk, Peer(message.worker, "", host)))

    def join(self, worker: str, procs: int = 1, wrong: bool = False) -> None:
        for number in range(procs):
            self.slots[worker, number] = Slot(worker, number)
        if wrong:
            self.wrong.add(worker)
        self.hello(worker)

    def hello(self, worker: str) -> None:
        procs = sum(1 for name, _ in self.slots if name == worker)
        if procs:
            self.say(Hello(worker, Capabilities(procs, ("idm",), False, False, VERSIONS)))

    def leave(self, worker: str, noticed: bool = True) -> None:
        """The worker dies; the scheduler is told, or has to find out."""
        for key in [key for key in self.slots if key[0] == worker]:
            del self.slots[key]
        if noticed:
            self.tell(E.Gone(worker))

    def ask(self, slot: Slot) -> None:
        slot.lease, slot.waiting = None, True
        self.say(Ask(slot.worker, slot.number), slot)

    def run(self, slot: Slot) -> None:
        """Run the slot's chunk; the answer is on its way."""
        lease = slot.lease
        assert lease is not None
        slot.lease = None
        self.answers.append(answer(lease, slot.worker, slot.worker in self.wrong))

    def deliver(self, which: int = 0, keep: bool = False) -> None:
        """An answer arrives; keep: and will once more."""
        one = self.answers[which] if keep else self.answers.pop(which)
        before = len(self.replies)
        self.say(one, None, chunk_of(one))
        replies = self.replies[before:]
        last = next((r for r in replies if isinstance(r, Refused)), None)
        if last is not None and last.unknown:
            self.hello(one.worker)
        alive = any(name == one.worker for name, _ in self.slots)
        if last is not None and (last.again or last.unknown) and alive and not keep:
            self.answers.append(one)  # the worker tries again

    # -- to the end ------------------------------------------------------------------------------------------

    def finish(self, steps: int = 20_000) -> None:
        """Let everything take its course until all jobs are over."""
        for _ in range(steps):
            if self.instructions:
                self.compute()
            elif self.writes:
                self.write()
            elif self.answers:
                self.deliver()
            elif busy := [slot for slot in self.slots.values() if slot.lease is not None]:
                self.run(busy[0])
            elif all(
                self.record.statuses.get(job, "running") not in ("running", "paused") for job in self.jobs
            ):
                return
            else:
                self.now += 1.0
                for slot in list(self.slots.values()):
                    if not slot.waiting and slot.lease is None:
                        self.ask(slot)
                self.tell(E.Tick())
        raise AssertionError(f"the jobs do not end: {self.record.statuses}, {self.scheduler.jobs}")

    def bits(self, job: str) -> tuple:
        return self.read(job)

    def counted_once(self, job: str) -> bool:
        """Whether every row of the job's batches is in one valid chunk, and none in two."""
        rows: set[tuple] = set()
        for key, chunk, _ in self.record.valid(job):
            mine = {(key[1], key[2], row) for row in range(chunk.start, chunk.stop)}
            if mine & rows:
                return False
            rows |= mine
        return len(rows) == self.bits(job)[3]


@lru_cache(maxsize=256)
def drawn(parameters: bytes, seed: int, phase: str, iteration: int) -> tuple[np.ndarray, np.ndarray]:
    """All rows that a batch of these jobs can have: drawing them takes longer than all the rest of a play."""
    return ce.draw(BASE.with_parameters(np.frombuffer(parameters)), seed, phase, iteration, 0, MOST_ROWS)


def answer(lease: Lease, worker: str, wrong: bool = False) -> Answer:
    """The answer of an honest worker, or of a wrong one."""
    key: ChunkKey = lease.chunk
    n = key.stop - key.start
    if isinstance(lease.rows, Drawn):
        x, noise_seeds = drawn(lease.rows.parameters, lease.rows.seed, key.phase, key.iteration)
        x, noise_seeds = x[key.start : key.stop], noise_seeds[key.start : key.stop]
    else:
        x = np.frombuffer(lease.rows.x).reshape(n, -1)
        noise_seeds = np.frombuffer(lease.rows.noise_seeds, np.uint64)
    assert rows_digest(row_hashes(x, noise_seeds)) == key.digest
    f, outcomes, errors = formula(x, noise_seeds)
    if wrong:
        f = f + 0.4 * (noise_seeds % 2)  # so much that the search goes elsewhere
    chunk = Chunk(key.start, key.stop, f, outcomes, np.full(n, 9, np.int32), errors, 0.05 * n)
    return answer_of(worker, lease.lease, key, chunk)
