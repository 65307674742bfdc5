"""Local workers: processes that run chunks of rollouts, one SUMO each.

A rollout that kills its process becomes a recorded error, and all others get their value (`process_pool`).
"""

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Literal, Protocol

import numpy as np

from service.evaluation.job import Job, compiled, in_sumo
from service.evaluation.process_pool import OnProcesses, ProcessPool, TaskKind
from service.evaluation.processes import context_for
from service.evaluation.store import FAILED, Chunk, failed_chunk
from service.world.sim.rollout import OUTCOMES, Rollout

OUTCOME_CODES = {name: code for code, name in enumerate(OUTCOMES.values())} | {"error": FAILED}
OUTCOME_NAMES = {code: name for name, code in OUTCOME_CODES.items()}


class RolloutWorld(Protocol):
    """What runs rollouts: `service.world.sim.rollout.Simulator`, or another that gives the same bits.

    in_sumo: how many of its rollouts SUMO has driven so far
    """

    in_sumo: int

    def begin_chunk(self) -> None: ...

    def run(self, x: np.ndarray, noise_seed: int) -> Rollout: ...


OpenWorld = Callable[[Job], RolloutWorld]  # called in each worker process; a function at a module's top level
InSumo = Literal[
    "some", "all"
]  # rollouts that SUMO drives: those that matter and a share of the others, or all
WORLDS: dict[InSumo, OpenWorld] = {"some": compiled, "all": in_sumo}


_world: RolloutWorld | None = None  # of this worker process


@dataclass(frozen=True)
class Work:
    """Rows [start, start + n) of a batch: x (n, d) and their noise seeds (n,)."""

    start: int
    x: np.ndarray
    noise_seeds: np.ndarray

    def row(self, index: int) -> "Work":
        return Work(self.start + index, self.x[index : index + 1], self.noise_seeds[index : index + 1])


def run_chunk(simulator: RolloutWorld, work: Work) -> Chunk:
    """Run a chunk's rollouts in this process."""
    began, before = time.perf_counter(), simulator.in_sumo
    simulator.begin_chunk()
    rollouts = [simulator.run(x, int(seed)) for x, seed in zip(work.x, work.noise_seeds, strict=True)]
    return Chunk(
        work.start,
        work.start + len(rollouts),
        np.array([r.f for r in rollouts], dtype=np.float64),
        np.array([OUTCOME_CODES[r.outcome] for r in rollouts], dtype=np.uint8),
        np.array([r.steps for r in rollouts], dtype=np.int32),
        {i: r.error for i, r in enumerate(rollouts) if r.error is not None},
        time.perf_counter() - began,
        in_sumo=simulator.in_sumo - before,
        contacts={i: r.contact for i, r in enumerate(rollouts) if r.contact is not None},
    )


def _open_worker(job: Job, open_world: OpenWorld) -> None:
    global _world
    _world = open_world(job)


def _run(work: Work) -> Chunk:
    assert _world is not None
    return run_chunk(_world, work)


def _rows(work: Work) -> list[Work]:
    return [work.row(i) for i in range(len(work.noise_seeds))]


def _lost(work: Work) -> Chunk:
    reason = "the worker process died during this rollout, each time it was tried"
    return failed_chunk(work.start, work.start + len(work.noise_seeds), reason)


def _joined(parts: Sequence[Chunk]) -> Chunk:
    first = parts[0].start
    return Chunk(
        first,
        parts[-1].stop,
        np.concatenate([p.f for p in parts]),
        np.concatenate([p.outcomes for p in parts]),
        np.concatenate([p.steps for p in parts]),
        {p.start - first + i: error for p in parts for i, error in p.errors.items()},
        sum(p.worker_s for p in parts),
        in_sumo=sum(p.in_sumo or 0 for p in parts),
        contacts={p.start - first + i: contact for p in parts for i, contact in (p.contacts or {}).items()},
    )


CHUNKS = TaskKind(_run, _rows, _joined, _lost)


class LocalPool(OnProcesses[Work, Chunk]):
    """Worker processes for one job; use as a context manager."""

    def __init__(self, job: Job, workers: int, open_world: OpenWorld = compiled):
        super().__init__(
            ProcessPool(workers, CHUNKS, _open_worker, (job, open_world), lambda: context_for(job.ego))
        )

    def warm_up(self) -> None:
        """Start the workers and let the first one compile the kernels for all."""
        self._processes.start()

    def pids(self) -> list[int]:
        """The worker processes there are now."""
        return self._processes.pids()

    def run(self, chunks: list[Work]) -> Iterator[Chunk]:
        """Run the chunks; each is yielded when it is done, in any order."""
        for _, chunk in self._processes.run(chunks):
            yield chunk
