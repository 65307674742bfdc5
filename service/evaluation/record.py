"""A job as far as its record goes: the evaluation loop, answered from the run directory alone."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, NoReturn, cast

import numpy as np

import ce
from ce.streams import CHUNK as STREAM_BLOCK
from service.errors import InputError
from service.evaluation.batches import RecordedBatches
from service.evaluation.endings import endings_of, estimate_of, outcomes_of
from service.evaluation.evaluate import evaluate
from service.evaluation.job import Job, Problem
from service.evaluation.options import PATHS, options_of
from service.evaluation.path_record import read_paths
from service.evaluation.path_store import PathSource
from service.evaluation.pool import OUTCOME_CODES, OUTCOME_NAMES
from service.evaluation.so_far import begun, state_after
from service.evaluation.store import FAILED, Chunk, ChunkSource
from service.evaluation.summary import Ending
from service.world.safety.contact import Contact
from service.world.scenario.base import before_weights
from service.world.scenario.measures import IMPACT
from service.world.scenario.noise import Noise

BatchKey = tuple[str, int]  # phase, iteration
KEPT_STARTS = 20_000  # rollouts of a job, at most, whose starts are kept


class EndOfRecord(Exception):
    """The record has no answer to the next batch, or not all of it."""


@dataclass(frozen=True)
class FailedRollout:
    """A rollout that ended in an error: row `row` of the batch stream (phase, iteration)."""

    phase: str
    iteration: int
    row: int
    noise_seed: int  # its noise seed
    reason: str


@dataclass(frozen=True)
class JobRecord:
    """What the record says of a job.

    estimate: of f <= estimate.gamma, from the batches that are complete and the first rows of one that is not
    parameters: of the proposal of each batch, by (phase, iteration)
    estimate_iteration: of the batches that the estimate is made of; a method that switches leaves others behind
    event_rows: the estimation rollouts with f <= estimate.gamma; none for methods that move chains instead of drawing a
        fresh sample
    event_log_likelihood: log p0(x) of each of them, nats
    explicit: x, noise seed and f of the events and failures of batches that cannot be drawn from parameters alone, by
        (phase, iteration, row)
    outcomes: how the recorded rollouts of each phase ended
    endings: how those ended that the estimate is made of, with probabilities
    errors: phase, iteration, row and reason of each failed rollout
    recorded: rollouts on record, those of an incomplete batch included
    worker_s, sim_s: seconds of workers, and simulated seconds, that they took
    in_sumo: how many of them SUMO drove
    contacts: of the rollouts that ended in one and have it on record, by (phase, iteration, row)
    contacts_recorded: whether all of them have
    explicit_batches: phase and iteration of the batches that `explicit` is of
    outcome: where the event is an ending, and not f <= gamma: which; `estimate` is then of that event
    f: values of the rollouts that the estimate is made of, in its order
    starts: (n, k) of evenly spread rollouts of all phases, the coordinates of x before the drivers' weights; none of
        the method that drives paths
    starts_f: (n,), f of those
    """

    job: Job
    problem: Problem
    estimate: ce.Estimate
    training: tuple[ce.TrainingRecord, ...]
    estimation: tuple[ce.EstimationRecord, ...]
    parameters: dict[BatchKey, np.ndarray]
    estimate_iteration: int
    event_rows: np.ndarray
    event_log_likelihood: np.ndarray
    explicit: dict[tuple[str, int, int], tuple[np.ndarray, Noise, float]]
    outcomes: dict[str, Counter[str]]
    errors: tuple[tuple[str, int, int, str], ...]  # phase, iteration, row, reason
    endings: tuple[Ending, ...]
    recorded: int
    worker_s: float
    sim_s: float
    in_sumo: int
    contacts: dict[tuple[str, int, int], Contact] = field(default_factory=dict)
    contacts_recorded: bool = False
    explicit_batches: frozenset[BatchKey] = frozenset()
    outcome: str | None = None
    f: np.ndarray = field(default_factory=lambda: np.zeros(0))
    starts: np.ndarray = field(default_factory=lambda: np.zeros((0, 0)))
    starts_f: np.ndarray = field(default_factory=lambda: np.zeros(0))

    @property
    def planned(self) -> int:
        """Rollouts at most."""
        if self.job.method == PATHS:
            return int(options_of(PATHS, self.job.options).budget)
        return self.problem.algorithm.total_rollouts

    def redraw(self, phase: str, iteration: int, row: int) -> tuple[np.ndarray, Noise]:
        """x (d,) and the noise seed of an event or a failure, drawn again just as its batch was."""
        return self.redraw_all(phase, [(iteration, row)])[0]

    def redraw_all(self, phase: str, keys: Sequence[tuple[int, int]]) -> list[tuple[np.ndarray, Noise]]:
        """x (d,) and the noise seed of many, by (iteration, row): rows of one block of the stream are drawn at once."""
        found: dict[tuple[int, int], tuple[np.ndarray, Noise]] = {
            key: self.explicit[phase, *key][:2] for key in keys if (phase, *key) in self.explicit
        }
        blocks: dict[tuple[int, int], list[int]] = {}
        for iteration, row in keys:
            if (iteration, row) not in found:
                if (phase, iteration) in self.explicit_batches:
                    raise InputError(
                        f"rollout {row} of phase {phase}, iteration {iteration} is neither dangerous nor failed: of "
                        f"method {self.estimate.method} only those are kept so that they can be brought back"
                    )
                blocks.setdefault((iteration, row // STREAM_BLOCK), []).append(row)
        for (iteration, _), rows in blocks.items():
            proposal = self.problem.base.with_parameters(self.parameters[phase, iteration])
            first = min(rows)
            x, noise_seeds = ce.draw(
                proposal, self.problem.stream_seed, phase, iteration, first, max(rows) + 1
            )
            found |= {
                (iteration, row): (x[row - first].copy(), int(noise_seeds[row - first])) for row in rows
            }
        return [found[key] for key in keys]

    @cached_property
    def proposal(self) -> ce.Product | None:
        """What the estimation rollouts are drawn from, where that is not the base and is known."""
        key = ("estimate", self.estimate_iteration)
        if not self.training or key not in self.parameters:
            return None
        return self.problem.base.with_parameters(self.parameters[key])

    def failures(self, limit: int) -> list[FailedRollout]:
        """The first failed rollouts, with the noise seeds that bring them back."""
        return [
            FailedRollout(phase, k, row, int(self.redraw(phase, k, row)[1]), reason)
            for phase, k, row, reason in self.errors[:limit]
        ]


def replay(store: ChunkSource, job: Job, gamma: float | None = None, outcome: str | None = None) -> JobRecord:
    """Replay a job's record through the evaluation loop until it is finished or the record ends.

    gamma: look at the event f <= gamma instead of the job's own; the search stays the one that there was
    outcome: look at the rollouts that ended so instead, whatever their f; InputError for a name that is none
    """
    problem = Problem(job)
    threshold = job.gamma if gamma is None else gamma
    if job.method == PATHS:
        return _of_paths(
            cast(PathSource, store), problem, threshold if outcome is None else _below(job, outcome)
        )
    chunks = list(store.all_chunks(job.id))
    ended_so = None if outcome is None else _Ended(chunks, outcome)
    algorithm = problem.algorithm
    recorded = RecordedBatches(store, job, no_workers)
    state: Any = algorithm.init(problem.stream_seed)
    records: list[ce.TrainingRecord | ce.EstimationRecord] = []
    parameters: dict[BatchKey, np.ndarray] = {}
    rows: dict[int, list[np.ndarray]] = {}
    likelihood: dict[int, list[np.ndarray]] = {}
    explicit: dict[tuple[str, int, int], tuple[np.ndarray, Noise, float]] = {}
    explicit_batches: set[BatchKey] = set()
    starts = _Starts(job, algorithm.total_rollouts)

    def told(batch: ce.Batch, f: np.ndarray) -> np.ndarray:
        parameters[batch.phase, batch.iteration] = batch.parameters
        starts.see(batch, f)
        dangerous = f <= threshold if ended_so is None else ended_so(batch)
        if batch.explicit:
            explicit_batches.add((batch.phase, batch.iteration))
            # a method that moves chains calls all its batches training
            kept_rows = np.isnan(f) | dangerous
            for i in np.flatnonzero(kept_rows).tolist():
                explicit[batch.phase, batch.iteration, batch.start + i] = (
                    batch.x[i].copy(),
                    int(batch.noise[i]),
                    float(f[i]),
                )
        if batch.phase == "estimate":
            events = np.flatnonzero(dangerous)
            rows.setdefault(batch.iteration, []).append(batch.start + events)
            likelihood.setdefault(batch.iteration, []).append(problem.base.log_density(batch.x[events]))
        return f

    def observe(after: Any, record: ce.TrainingRecord | ce.EstimationRecord) -> None:
        nonlocal state
        state = after
        records.append(record)

    try:
        estimate = evaluate(
            algorithm, problem.stream_seed, lambda batch: told(batch, recorded(batch)), observe
        )
    except EndOfRecord:
        part = begun(algorithm.propose(state), chunks)
        if part is not None and (after := state_after(algorithm, state, *part)) is not state:
            told(*part)
            state = after
        estimate = algorithm.estimate(state)
    if threshold != job.gamma:
        estimate = replace(estimate, gamma=threshold)
    endings, f = endings_of(estimate, chunks), estimate.f
    if ended_so is not None:
        estimate = estimate_of(estimate, outcomes_of(estimate, chunks), ended_so.code)

    last = max(rows, default=0)
    return JobRecord(
        job=job,
        problem=problem,
        estimate=estimate,
        training=tuple(r for r in records if isinstance(r, ce.TrainingRecord)),
        estimation=tuple(r for r in records if isinstance(r, ce.EstimationRecord)),
        parameters=parameters,
        estimate_iteration=last,
        event_rows=np.concatenate([np.zeros(0, np.int64), *rows.get(last, [])]),
        event_log_likelihood=np.concatenate([np.zeros(0), *likelihood.get(last, [])]),
        explicit=explicit,
        endings=endings,
        explicit_batches=frozenset(explicit_batches),
        outcome=outcome,
        f=f,
        starts=starts.seen,
        starts_f=starts.f,
        **_totals(job, chunks),
    )


def _below(job: Job, outcome: str) -> float:
    """The threshold at and below which rollouts have that outcome; InputError where f does not tell it."""
    if outcome == "collision" and job.scenario.safety.measure == IMPACT:
        return 0.0
    raise InputError(
        f"outcome {outcome!r}: of method {job.method} only paths with f <= gamma are kept so that they can be brought "
        f"back, and f tells collisions alone, with the measure {IMPACT}; ask without an outcome, or of another method"
    )


def _of_paths(store: PathSource, problem: Problem, gamma: float) -> JobRecord:
    """Of a job of paths, whose events are paths (`service.evaluation.path_record`)."""
    job = problem.job
    read = read_paths(store, problem, gamma)
    chunks = list(store.all_chunks(job.id))
    return JobRecord(
        job=job,
        problem=problem,
        estimate=read.estimate,
        training=tuple(r for r in read.records if isinstance(r, ce.TrainingRecord)),
        estimation=tuple(r for r in read.records if isinstance(r, ce.EstimationRecord)),
        parameters={},
        estimate_iteration=0,
        event_rows=np.zeros(0, np.int64),
        event_log_likelihood=np.zeros(0),
        explicit=read.events,
        endings=endings_of(read.estimate, chunks, read.told),
        explicit_batches=frozenset((phase, iteration) for phase, iteration, _ in read.events),
        **_totals(job, chunks) | {"contacts": read.contacts},
    )


def _totals(job: Job, chunks: Sequence[tuple[str, int, Chunk]]) -> dict[str, Any]:
    """What a job's chunks come to together."""
    outcomes: dict[str, Counter[str]] = {}
    errors: list[tuple[str, int, int, str]] = []
    contacts: dict[tuple[str, int, int], Contact] = {}
    count, worker_s, steps, in_sumo, recorded = 0, 0.0, 0, 0, True
    for phase, iteration, chunk in chunks:
        codes, counts = np.unique(chunk.outcomes, return_counts=True)
        ended = outcomes.setdefault(phase, Counter())
        for code, times in zip(codes.tolist(), counts.tolist(), strict=True):
            ended[OUTCOME_NAMES.get(code, f"code {code}")] += times
        errors += [(phase, iteration, chunk.start + i, reason) for i, reason in sorted(chunk.errors.items())]
        count += chunk.stop - chunk.start
        worker_s += chunk.worker_s
        steps += int(chunk.steps.sum())
        in_sumo += chunk.driven_in_sumo
        contacts |= {(phase, iteration, chunk.start + i): c for i, c in (chunk.contacts or {}).items()}
        recorded = recorded and (chunk.contacts is not None or OUTCOME_CODES["collision"] not in codes)
    return {
        "outcomes": outcomes,
        "errors": tuple(errors),
        "recorded": count,
        "worker_s": worker_s,
        "sim_s": steps * job.scenario.time.step_s,
        "in_sumo": in_sumo,
        "contacts": contacts,
        "contacts_recorded": recorded,
    }


class _Starts:
    """Every so many rollouts' coordinates before the drivers' weights, KEPT_STARTS at most."""

    def __init__(self, job: Job, rollouts: int) -> None:
        self._columns = before_weights(job.scenario)
        self._every = -(-max(rollouts, 1) // KEPT_STARTS)
        self._next = 0  # rows until the next one is kept
        self._kept = [np.zeros((0, self._columns))]
        self._f = [np.zeros(0)]

    def see(self, batch: ce.Batch, f: np.ndarray) -> None:
        self._kept.append(batch.x[self._next :: self._every, : self._columns].copy())
        self._f.append(f[self._next :: self._every].copy())
        self._next = (self._next - len(batch.x)) % self._every

    @property
    def seen(self) -> np.ndarray:
        return np.concatenate(self._kept)

    @property
    def f(self) -> np.ndarray:
        return np.concatenate(self._f)


class _Ended:
    """Which rollouts of a batch ended with one outcome."""

    def __init__(self, chunks: Sequence[tuple[str, int, Chunk]], outcome: str) -> None:
        known = [name for name in OUTCOME_CODES if OUTCOME_CODES[name] != FAILED]
        if outcome not in known:
            raise InputError(f"no outcome named {outcome!r}; there are {', '.join(known)}")
        self.code = OUTCOME_CODES[outcome]
        self._rows: dict[BatchKey, list[np.ndarray]] = {}
        for phase, iteration, chunk in chunks:
            rows = chunk.start + np.flatnonzero(chunk.outcomes == self.code)
            self._rows.setdefault((phase, iteration), []).append(rows)

    def __call__(self, batch: ce.Batch) -> np.ndarray:
        rows = np.concatenate([np.zeros(0, np.int64), *self._rows.get((batch.phase, batch.iteration), [])])
        return np.isin(np.arange(batch.start, batch.stop), rows)


def no_workers() -> NoReturn:
    raise EndOfRecord
