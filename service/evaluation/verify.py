"""Checks a record: every chunk's checksum, what was drawn, whether each rollout is there once, and a sample run again.

A chunk that is damaged is left out; what the others come to is what can be saved. A rollout is a pure function of its x
and noise seed, so one that is run again must give its f to the bit.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np
import sqlalchemy as sa

import ce
from service.errors import StoreError, TailroadError
from service.evaluation.batches import RecordedBatches
from service.evaluation.evaluate import evaluate
from service.evaluation.job import Job, Problem, in_sumo
from service.evaluation.options import PATHS
from service.evaluation.pool import OUTCOME_CODES, LocalPool, Work
from service.evaluation.record import EndOfRecord, no_workers
from service.evaluation.store import Chunk
from service.evaluation.store.chunk import chunk_of
from service.world.egos.open import check_ego


@dataclass(frozen=True)
class Verified:
    """What was found of a job's record.

    chunks, rollouts: on record, the damaged ones included
    old: of the chunks, those of before there were checksums
    sound: rollouts of chunks that say what they said when they were written, and of the rows that the job draws
    usable: of these, the ones that the job's batches, one after the other, ask for: what can be saved
    finished: whether they take the job to its end
    again: rollouts that were run again; different: of these, those that gave something else
    damage: what is wrong, a sentence each
    """

    job: str
    chunks: int
    rollouts: int
    old: int
    sound: int
    usable: int
    finished: bool
    again: int
    different: int
    damage: tuple[str, ...]


@dataclass(frozen=True)
class _Sampled:
    """A recorded rollout, to be run again."""

    where: str
    work: Work
    f: float
    outcome: int


def verify(name: str, job: Job, rows: Iterable[sa.Row], sample: int, workers: int) -> Verified:
    """Check the record of a job, given as the rows of its chunks by phase, iteration and start, and run `sample` of its
    rollouts again, drawn evenly and the same ones each time.

    Of a job of paths the chunks alone are looked at; what is kept beside them carries checksums that every read checks.
    """
    sound = _SoundChunks()
    damage = sound.damage
    try:
        sound.take(rows)
    except StoreError as error:
        damage.append(str(error))
    if job.method == PATHS:
        whole = not damage and sound.count > 0
        told = name, sound.count, sound.rollouts, sound.old, sound.sound_rollouts, sound.sound_rollouts
        return Verified(*told, finished=whole, again=0, different=0, damage=tuple(damage))
    found = _Replay(sound, sample)
    again = different = 0
    finished = False
    try:
        problem = Problem(job)
        finished = found.run(problem)
        check_ego(job.ego)
        if found.sampled:
            with LocalPool(job, workers, in_sumo) as pool:
                for wrong in _different(pool, found.sampled):
                    different += 1
                    damage.append(wrong)
            again = len(found.sampled)
    except (TailroadError, ce.CeError, ValueError, OSError) as error:
        damage.append(f"the job cannot be run here: {error}")
    return Verified(name, sound.count, sound.rollouts, sound.old, sound.sound_rollouts, found.usable, finished, again,
                    different, tuple(damage))  # fmt: skip


class _SoundChunks:
    """The chunks that are not damaged, as a `service.evaluation.store.ChunkSource`."""

    def __init__(self) -> None:
        self.count = self.rollouts = self.old = self.sound_rollouts = 0
        self.damage: list[str] = []
        self._chunks: dict[tuple[str, int], list[Chunk]] = {}

    def take(self, rows: Iterable[sa.Row]) -> None:
        for row in rows:
            self.count += 1
            if isinstance(row.start, int) and isinstance(row.stop, int):
                self.rollouts += max(row.stop - row.start, 0)
            try:
                chunk = chunk_of(row)
            except StoreError as error:
                self.damage.append(str(error))
                continue
            self.old += not row.checksum
            before = self._chunks.setdefault((row.phase, row.iteration), [])
            if before and chunk.start < before[-1].stop:
                self.damage.append(
                    f"rollouts {chunk.start} to {min(chunk.stop, before[-1].stop)} (phase {row.phase}, iteration "
                    f"{row.iteration}) are recorded twice"
                )
                continue
            before.append(chunk)
            self.sound_rollouts += chunk.stop - chunk.start

    def chunks(
        self, job_id: str, phase: str, iteration: int, start: int = 0, stop: int | None = None
    ) -> list[Chunk]:
        found = self._chunks.get((phase, iteration), [])
        return [c for c in found if c.stop > start and (stop is None or c.start < stop)]

    def all_chunks(self, job_id: str) -> Iterator[tuple[str, int, Chunk]]:
        for (phase, iteration), found in self._chunks.items():
            for chunk in found:
                yield phase, iteration, chunk

    def other_draws(self, chunk: Chunk) -> None:
        self.sound_rollouts -= chunk.stop - chunk.start
        self.damage.append(
            f"rollouts {chunk.start} to {chunk.stop} are of other random draws than the job makes here: its seed, "
            "scenario, weights or options, or the software, are not those that they were run with"
        )

    def append(self, job_id: str, phase: str, iteration: int, chunk: Chunk) -> None:
        raise TypeError("a record that is being checked stays as it is")


class _Replay:
    """The job's batches, answered by the sound chunks; a sample of the rollouts is kept on the way."""

    def __init__(self, sound: _SoundChunks, sample: int):
        self._sound, self._sample = sound, sample
        self._rng = np.random.default_rng(0)
        self._kept: list[
            tuple[float, _Sampled]
        ] = []  # the smallest of random keys: each rollout is as likely
        self.usable = 0

    @property
    def sampled(self) -> list[_Sampled]:
        return [one for _, one in self._kept]

    def run(self, problem: Problem) -> bool:
        """Whether the record takes the job to its end."""
        recorded = RecordedBatches(self._sound, problem.job, no_workers, self._on_chunk)

        def run_batch(batch: ce.Batch) -> np.ndarray:
            self._batch = batch
            return recorded(batch)

        try:
            evaluate(problem.algorithm, problem.stream_seed, run_batch)
        except EndOfRecord:
            return False
        return True

    def _on_chunk(self, chunk: Chunk, replayed: bool) -> None:
        batch = self._batch
        first, last = max(chunk.start, batch.start), min(chunk.stop, batch.stop)
        self.usable += last - first
        keys = self._rng.random(last - first)
        for i in np.argsort(keys)[: self._sample].tolist():
            row = first + i
            part = slice(row - batch.start, row - batch.start + 1)
            where = f"rollout {row} (phase {batch.phase}, iteration {batch.iteration})"
            work = Work(row, batch.x[part].copy(), batch.noise[part].copy())
            of_chunk = row - chunk.start
            one = _Sampled(where, work, float(chunk.f[of_chunk]), int(chunk.outcomes[of_chunk]))
            self._kept.append((float(keys[i]), one))
        self._kept = sorted(self._kept, key=lambda kept: kept[0])[: self._sample]


def _different(pool: LocalPool, sampled: list[_Sampled]) -> Iterator[str]:
    """What is told of each rollout that does not give what is on record."""
    for one in sampled:
        (chunk,) = pool.run([one.work])
        if chunk.f[0].tobytes() != np.float64(one.f).tobytes() or chunk.outcomes[0] != one.outcome:
            names = {code: name for name, code in OUTCOME_CODES.items()}
            told = chunk.errors.get(0, f"f = {chunk.f[0]!r}, {names[int(chunk.outcomes[0])]}")
            yield f"{one.where} has f = {one.f!r}, {names.get(one.outcome, one.outcome)}, on record; run again: {told}"
