"""The database of a fleet in memory."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

from service.evaluation.store import Chunk, Origin
from service.evaluation.store.jobs import Mark
from service.evaluation.store.records import ChunkRecord
from service.evaluation.store.states import KeptState, LastState
from service.remote.fleet import events as E


@dataclass
class Record:
    """The database: chunks with what they are of, voids; nothing is ever changed."""

    chunks: dict[tuple, tuple[Chunk, Origin]] = field(default_factory=dict)
    voids: dict[tuple, int] = field(default_factory=dict)
    audits: set[tuple] = field(default_factory=set)
    statuses: dict[str, str] = field(default_factory=dict)
    quarantined: dict[str, str] = field(default_factory=dict)
    batches: dict[tuple[str, int], int] = field(default_factory=dict)  # complete ones, by job and epoch
    states: dict[tuple[str, int], KeptState] = field(default_factory=dict)
    on_read: Callable[[], None] = lambda: None  # called before chunks are read

    def append(self, r: E.Record) -> None:
        key = (r.job, r.phase, r.iteration, r.chunk.start, r.origin.epoch)
        self.chunks.setdefault(key, (r.chunk, r.origin))

    def valid(self, job: str) -> list[tuple[tuple, Chunk, Origin]]:
        return [
            (key, chunk, origin)
            for key, (chunk, origin) in sorted(self.chunks.items(), key=lambda item: item[0])
            if key[0] == job and key not in self.voids
        ]

    def epoch(self, job: str) -> int:
        return max((epoch for key, epoch in self.voids.items() if key[0] == job), default=0)

    def read(self, job: str):
        def chunks(phase: str, iteration: int, start: int, stop: int) -> list[tuple[Chunk, Origin]]:
            return [
                (chunk, origin)
                for key, chunk, origin in self.valid(job)
                if key[1:3] == (phase, iteration) and chunk.stop > start and chunk.start < stop
            ]

        return chunks

    def quarantine(self, worker: str, reason: str) -> tuple[str, ...]:
        self.quarantined[worker] = reason
        doubtful = [
            key
            for job in {key[0] for key in self.chunks}
            for key, _, origin in self.valid(job)
            if origin.worker == worker and key not in self.audits
        ]
        jobs = sorted({key[0] for key in doubtful})
        later = {job: self.epoch(job) + 1 for job in jobs}
        self.voids |= {key: later[key[0]] for key in doubtful}
        return tuple(sorted({key[0] for key in self.voids if self.chunks[key][1].worker == worker}))


class MemoryStore:
    """A record as `service.remote.fleet.statistics` reads it (service.evaluation.store.jobs.JobStore)."""

    def __init__(self, record: Record):
        self._record = record
        self.chunks = _Chunks(record)
        self.states = _States(record)
        self.epoch = record.epoch

    def mark(self, job: str) -> Mark:
        record = self._record
        counts = [sum(key[0] == job for key in table) for table in (record.chunks, record.voids)]
        return Mark(record.statuses.get(job, "running"), record.epoch(job), *counts)

    def batches(self, job: str, epoch: int) -> int:
        return self._record.batches.get((job, epoch), 0)

    def void(self, job: str, names, next_epoch: int, why: str) -> None:
        for name in names:
            self._record.voids.setdefault((job, *name), next_epoch)


class _Chunks(ChunkRecord):
    def __init__(self, record: Record):
        self._record = record

    def chunks(self, job: str, phase: str, iteration: int, start: int = 0, stop: int | None = None):
        self._record.on_read()
        return self._record.read(job)(phase, iteration, start, stop)

    def with_origins(self, job: str) -> Iterator[tuple[str, int, Chunk, Origin]]:
        self._record.on_read()
        return iter([(key[1], key[2], chunk, origin) for key, chunk, origin in self._record.valid(job)])


class _States:
    def __init__(self, record: Record):
        self._states = record.states

    def keep(self, last: LastState, unreadable: bytes | None = None) -> None:
        there = self._states.get((last.job, last.epoch))
        same = there is not None and there.sound and there.last.record == last.record
        if not same or there.last.state == unreadable:
            self._states[last.job, last.epoch] = KeptState(last, True)

    def kept(self, job: str, epoch: int) -> KeptState | None:
        return self._states.get((job, epoch))

    def without_checksum(self) -> list[str]:
        return sorted({job for (job, _), kept in self._states.items() if not kept.sound})
