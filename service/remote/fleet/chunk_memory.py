"""What estimates need of a job's chunks, kept so that who asks again has only the new ones read.

A chunk never changes; it is there or it is void. So the names of those that there are tell what is to be read.
"""

import threading
from collections import OrderedDict
from dataclasses import dataclass, field, replace

import numpy as np

from service.evaluation.store import Chunk
from service.evaluation.store.records import ChunkName, ChunkRecord

MOST_ROLLOUTS = 5_000_000  # of all jobs together, nine bytes each; those asked for last stay


@dataclass(frozen=True)
class _Kept:
    """A chunk's f and outcomes, and what it cost."""

    chunk: Chunk
    worker_s: float
    steps: int
    in_sumo: int


@dataclass
class _OfJob:
    lock: threading.Lock = field(default_factory=threading.Lock)
    chunks: dict[ChunkName, _Kept] = field(default_factory=dict)

    @property
    def rollouts(self) -> int:
        return sum(kept.chunk.f.size for kept in self.chunks.values())


@dataclass(frozen=True)
class JobChunks:
    """The chunks of a job, as (phase, iteration, chunk) in the order of the record, of which steps and errors are left
    out; and what they cost: worker seconds, simulated steps, rollouts that SUMO drove."""

    chunks: list[tuple[str, int, Chunk]]
    worker_s: float
    steps: int
    in_sumo: int


class ChunkMemory:
    """The chunks of the jobs that were asked for last; may be called from any thread."""

    def __init__(self, record: ChunkRecord, most: int = MOST_ROLLOUTS):
        self._record, self._most = record, most
        self._lock = threading.Lock()
        self._jobs: OrderedDict[str, _OfJob] = OrderedDict()

    def of(self, job: str) -> JobChunks:
        """The job's chunks as they are in the record now; StoreError where they cannot be read."""
        with self._lock:
            known = self._jobs.setdefault(job, _OfJob())
            self._jobs.move_to_end(job)
        with known.lock:
            names = self._record.names(job)
            known.chunks = {name: known.chunks[name] for name in names if name in known.chunks}
            known.chunks |= self._read(job, [name for name in names if name not in known.chunks])
            found = [(name[0], name[1], known.chunks[name]) for name in names if name in known.chunks]
        with self._lock:
            self._forget()
        kept = [one for _, _, one in found]
        return JobChunks(
            [(phase, iteration, one.chunk) for phase, iteration, one in found],
            sum(one.worker_s for one in kept),
            sum(one.steps for one in kept),
            sum(one.in_sumo for one in kept),
        )

    def _read(self, job: str, names: list[ChunkName]) -> dict[ChunkName, _Kept]:
        """The chunks of these names, a batch's at a time."""
        found: dict[ChunkName, _Kept] = {}
        batches: dict[tuple[str, int], list[ChunkName]] = {}
        for name in names:
            batches.setdefault(name[:2], []).append(name)
        for (phase, iteration), listed in batches.items():
            wanted = set(listed)
            first, last = min(name[2] for name in wanted), max(name[2] for name in wanted)
            for chunk, origin in self._record.chunks(job, phase, iteration, first, last + 1):
                name = (phase, iteration, chunk.start, origin.epoch)
                if name in wanted:
                    found[name] = _kept(chunk)
        return found

    def _forget(self) -> None:
        """Those asked for longest ago, as far as there is no room; the last one stays."""
        held = sum(job.rollouts for job in self._jobs.values())
        while held > self._most and len(self._jobs) > 1:
            held -= self._jobs.popitem(last=False)[1].rollouts


def _kept(chunk: Chunk) -> _Kept:
    steps = int(chunk.steps.sum())
    light = replace(chunk, steps=np.zeros(0, np.int32), errors={})
    return _Kept(light, chunk.worker_s, steps, chunk.driven_in_sumo)
