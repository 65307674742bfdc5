"""Ground truth: naive rollouts that accumulate, in a file small enough to keep beside the sources.

Row i of the naive stream of a seed is the same rollout for everyone, so that a later run goes on where this one
stopped. Kept are which rows were run, f and outcome of the dangerous ones (f below CUTOFF_S), the failed ones, and what
all of them cost; the others' f is known to be at least CUTOFF_S, which is all that thresholds below it need.
"""

import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple, Protocol
from zipfile import BadZipFile

import msgspec
import numpy as np

import ce
from ce.interval import clopper_pearson
from service.errors import StoreError
from service.evaluation.job import Job, make_job
from service.evaluation.store import FAILED, Chunk
from service.studies.reproduce.identity import digest_of
from service.studies.reproduce.plans import Truth
from service.world.scenario import load_scenario

CUTOFF_S = 1.0
FORMAT = 1
SAVED_EVERY = 20  # chunks
CONFIDENCE = 0.95


class Ran(msgspec.Struct, kw_only=True):
    """What was run: rows [start, stop) each, their outcomes, and the cost."""

    format: int
    scenario: str
    ego: str
    seed: int
    digest: str
    ranges: list[tuple[int, int]]
    outcomes: dict[int, int]
    worker_s: float
    steps: int


class Kept(NamedTuple):
    """What a ground truth's file holds.

    rows, f, outcomes: (n,), of the rollouts that are kept, by row
    """

    ran: Ran
    rows: np.ndarray
    f: np.ndarray
    outcomes: np.ndarray


def read_truth(path: Path) -> Kept:
    """A ground truth's file, whichever rollouts it is of; StoreError for a file that is not one."""
    try:
        with np.load(path, allow_pickle=False) as stored:
            ran = msgspec.json.decode(stored["ran"].tobytes(), type=Ran)
            rows, f, codes = stored["rows"], stored["f"], stored["outcomes"]
    except (OSError, ValueError, KeyError, EOFError, BadZipFile, msgspec.MsgspecError) as error:
        raise StoreError(
            f"{path} is not a readable ground truth ({error}); remove it to start anew"
        ) from error
    if ran.format != FORMAT or not rows.shape == f.shape == codes.shape:
        raise StoreError(f"{path} has another format; remove it to start anew")
    return Kept(ran, rows.astype(np.int64), f, codes)


def write_truth(path: Path, kept: Kept) -> None:
    """Write the file, whole or not at all."""
    path.parent.mkdir(parents=True, exist_ok=True)
    part = path.with_name(path.name + ".part")
    with part.open("wb") as file:
        np.savez_compressed(
            file,
            ran=np.frombuffer(msgspec.json.encode(kept.ran), np.uint8),
            rows=kept.rows.astype(np.uint32),
            f=kept.f,
            outcomes=kept.outcomes,
        )
        file.flush()
        os.fsync(file.fileno())
    part.replace(path)


class KnownTruth(Protocol):
    """What tables and pictures need of a ground truth."""

    @property
    def rollouts(self) -> int: ...

    @property
    def worker_s(self) -> float: ...

    def at(self, gammas: Any) -> dict[str, np.ndarray]:
        """p, its interval (low, high), std_error and events at each threshold."""


def truth_job(truth: Truth) -> Job:
    """The naive job whose rollouts it is."""
    scenario = load_scenario(truth.scenario)
    return make_job(scenario, truth.ego, 0.5, "naive", truth.seed, {"budget": truth.rollouts})


class GroundTruth:
    """The record of a naive job's rollouts, a `service.evaluation.store.ChunkSource`; one process at a time writes."""

    def __init__(self, path: Path, job: Job):
        """StoreError for a file that is not one, or of other rollouts."""
        self.path = path
        self._unsaved = 0
        self._rows = np.zeros(0, np.int64)
        self._f = np.zeros(0)
        self._codes = np.zeros(0, np.uint8)
        self.ran = Ran(format=FORMAT, scenario=job.scenario.name, ego=job.ego, seed=job.seed, digest=digest_of(job),
                       ranges=[], outcomes={}, worker_s=0.0, steps=0)  # fmt: skip
        if path.exists():
            self._load(self.ran.digest)

    def _load(self, expected: str) -> None:
        ran, rows, f, codes = read_truth(self.path)
        if ran.digest != expected:
            raise StoreError(
                f"{self.path} holds rollouts of another scenario, other drivers or another ego (digest {ran.digest}, "
                f"expected {expected}); move it away to start anew, or, if only code was rewritten, see "
                "service/studies/reproduce/spot_check.py"
            )
        self.ran, self._rows, self._f, self._codes = ran, rows, f, codes

    def __enter__(self) -> "GroundTruth":
        return self

    def __exit__(self, *_: object) -> None:
        self.save()

    # -- as a store ------------------------------------------------------------------------------------------

    def append(self, job_id: str, phase: str, iteration: int, chunk: Chunk) -> None:
        """Record a finished chunk; written to disk now and then, and at the end."""
        keep = (chunk.f < CUTOFF_S) | np.isnan(chunk.f)
        self._rows = np.concatenate([self._rows, chunk.start + np.flatnonzero(keep)])
        self._f = np.concatenate([self._f, chunk.f[keep]])
        self._codes = np.concatenate([self._codes, chunk.outcomes[keep]])
        order = np.argsort(self._rows, kind="stable")
        self._rows, self._f, self._codes = self._rows[order], self._f[order], self._codes[order]
        for code, times in zip(*np.unique(chunk.outcomes, return_counts=True), strict=True):
            self.ran.outcomes[int(code)] = self.ran.outcomes.get(int(code), 0) + int(times)
        self.ran.worker_s += chunk.worker_s
        self.ran.steps += int(chunk.steps.sum())
        self.ran.ranges = _joined([*self.ran.ranges, (chunk.start, chunk.stop)])
        self._unsaved += 1
        if self._unsaved >= SAVED_EVERY:
            self.save()

    def other_draws(self, chunk: Chunk) -> None:
        """Nothing: what was drawn is not kept of each chunk, but of all by `digest_of`."""

    def chunks(
        self, job_id: str, phase: str, iteration: int, start: int = 0, stop: int | None = None
    ) -> list[Chunk]:
        """What was run of rows [start, stop); f above the cutoff is infinite, and its outcome is left at 0."""
        found = []
        for first, last in self.ran.ranges:
            a, b = max(first, start), last if stop is None else min(last, stop)
            if a < b:
                found.append(self._chunk(a, b))
        return found

    def _chunk(self, start: int, stop: int) -> Chunk:
        low, high = np.searchsorted(self._rows, [start, stop])
        rows = self._rows[low:high] - start
        f = np.full(stop - start, np.inf)
        codes = np.zeros(stop - start, np.uint8)
        f[rows], codes[rows] = self._f[low:high], self._codes[low:high]
        errors = dict.fromkeys(rows[codes[rows] == FAILED].tolist(), "failed")
        return Chunk(start, stop, f, codes, np.zeros(stop - start, np.int32), errors, 0.0)

    def all_chunks(self, job_id: str) -> Iterator[tuple[str, int, Chunk]]:
        for chunk in self.chunks(job_id, "estimate", 0):
            yield "estimate", 0, chunk

    def save(self) -> None:
        """Write the file, whole or not at all."""
        if not self._unsaved:
            return
        write_truth(self.path, Kept(self.ran, self._rows, self._f, self._codes))
        self._unsaved = 0

    # -- as an answer ----------------------------------------------------------------------------------------

    @property
    def rollouts(self) -> int:
        """Rows from 0 on without a gap: what estimates are made of."""
        return self.ran.ranges[0][1] if self.ran.ranges and self.ran.ranges[0][0] == 0 else 0

    @property
    def worker_s(self) -> float:
        """What all of it has cost."""
        return self.ran.worker_s

    def lowest(self, count: int) -> np.ndarray:
        """The smallest values of f, rising."""
        within = self._f[(self._rows < self.rollouts) & ~np.isnan(self._f)]
        return np.sort(within)[:count]

    def at(self, gammas: Any, limit: int | None = None) -> dict[str, np.ndarray]:
        """p, its interval and the events at each threshold, from the first `limit` rollouts. ValueError for a threshold
        above the cutoff."""
        asked = np.atleast_1d(np.asarray(gammas, dtype=np.float64))
        if not (asked < CUTOFF_S).all():
            raise ValueError(f"the ground truth knows thresholds below {CUTOFF_S:g} s, not {asked.max():g}")
        n = self.rollouts if limit is None else min(limit, self.rollouts)
        values = np.sort(self._f[(self._rows < n) & ~np.isnan(self._f)])
        events = np.searchsorted(values, asked, side="right")
        low, high = clopper_pearson(events, n, CONFIDENCE)
        p = events / n if n else np.full(asked.size, np.nan)
        return {
            "p": p,
            "low": low,
            "high": high,
            "events": events,
            "std_error": np.sqrt(p * (1.0 - p) / max(n, 1)),
        }

    def state(self, algorithm: ce.Naive, seed: int) -> Any:
        """The naive algorithm's state after the rollouts that there are, from which it goes on."""
        start = algorithm.init(seed)
        n = min(self.rollouts, algorithm.total_rollouts)
        return msgspec.structs.replace(start, f=self._chunk(0, n).f, done=n >= algorithm.total_rollouts)


def _joined(ranges: list[tuple[int, int]]) -> list[tuple[int, int]]:
    """The same rows in as few ranges as there can be."""
    joined: list[tuple[int, int]] = []
    for start, stop in sorted(ranges):
        if joined and start <= joined[-1][1]:
            joined[-1] = (joined[-1][0], max(joined[-1][1], stop))
        else:
            joined.append((start, stop))
    return joined
