"""A job whose method drives paths: the evaluation loop with the run directory as its memory.

The loop is that of `service.evaluation.evaluate`; batches are of paths, and what was run before is answered from the
record: the state when the pilot was over, then each batch of the estimate.
"""

from collections.abc import Callable
from typing import Any

import msgspec

import ce
from ce.naive import record_of
from ce.paths import PathBatch, PathEstimate, PathSampling, PathTotals
from service.errors import StoreError
from service.evaluation.job import Job, Problem
from service.evaluation.path_store import (
    COMMITTOR,
    GIVEN,
    PILOT,
    Artefacts,
    KeptBatch,
    PathSource,
    chunk_of_batch,
    committor_of,
    keep_batch,
    kept_batch,
)
from service.evaluation.path_work import PathAnswer, PathPool
from service.evaluation.store import Chunk
from service.evaluation.tolerance import Tolerance

LEAST_BATCHES = 2  # of which there is an estimate
Drive = Callable[[PathBatch], PathAnswer]
Observe = Callable[[Any, ce.TrainingRecord | ce.EstimationRecord], None]


class EndOfPaths(Exception):
    """There is no worker to drive the next batch; the state that was reached is kept in `state`."""

    def __init__(self, state: Any):
        super().__init__("the record ends here")
        self.state = state


def algorithm_of(problem: Problem, artefacts: Artefacts) -> PathSampling:
    """The algorithm of a job of paths, with the committor that it was given, where it was."""
    job = problem.job
    given = artefacts.kept(job.id, GIVEN)
    committor = None
    if job.committor_sha256:
        if given is None:
            raise StoreError(f"job {job.id} was given a committor, which its record has not; start a new run")
        committor = committor_of(given, "the committor that the run was given")
        if committor.checksum != job.committor_sha256:
            raise StoreError(
                f"the committor in the record of job {job.id} is another than it was given; start a new run"
            )
    return problem.path_algorithm(committor)


def carry_on(
    store: PathSource,
    problem: Problem,
    algorithm: PathSampling,
    drive: Drive | None,
    on_chunk: Callable[[Chunk, bool], None] = lambda chunk, replayed: None,
    observe: Observe = lambda state, record: None,
    tolerance: Tolerance | None = None,
    see: Callable[[KeptBatch], None] = lambda kept: None,
) -> Any:
    """The last state of a job of paths, from wherever its record stands.

    drive: what drives a batch; None for a record that is only read: EndOfPaths where it has no answer
    see: shown each batch of the estimate
    """
    job, tolerance = problem.job, tolerance or Tolerance()
    state = _after_pilot(store, problem, algorithm, drive, on_chunk, observe, tolerance)
    while state.phase == "estimate":
        kept = kept_batch(store.artefacts, job.id, state.iteration)
        if kept is None:
            if drive is None:
                raise EndOfPaths(state)
            batch = algorithm.propose(state)
            assert batch is not None
            answer = drive(batch)
            chunk = chunk_of_batch(batch, answer.driven, answer.worker_s, answer.in_sumo)
            tolerance.see(chunk)
            kept = KeptBatch(batch, answer.driven, answer.worker_s)
            keep_batch(store.artefacts, job.id, job.gamma, kept)
            store.append(job.id, "estimate", batch.iteration, chunk)
            on_chunk(chunk, False)
        else:
            for chunk in store.chunks(job.id, "estimate", state.iteration):
                tolerance.see(chunk)
                on_chunk(chunk, True)
        see(kept)
        state, totals = algorithm.update(state, kept.batch, kept.driven)
        if state.iteration >= LEAST_BATCHES:
            observe(state, estimation_record(algorithm, state, totals))
    return state


def _after_pilot(
    store: PathSource,
    problem: Problem,
    algorithm: PathSampling,
    drive: Drive | None,
    on_chunk: Callable[[Chunk, bool], None],
    observe: Observe,
    tolerance: Tolerance,
) -> Any:
    """The state with which the estimate begins."""
    job = problem.job
    there = store.artefacts.kept(job.id, PILOT)
    if there is not None:
        try:
            state = algorithm.from_bytes(there)
        except ce.StateError as error:
            raise StoreError(
                f"the record of job {job.id} is of another question than its run.json asks ({error}); start a new run "
                "with another --out"
            ) from error
        for phase, _, chunk in store.all_chunks(job.id):
            if phase == "train":
                on_chunk(chunk, True)
        for i, done in enumerate(state.rounds):
            observe(state, training_record(done.totals, done.reached, i))
        return state
    if drive is None:
        raise EndOfPaths(algorithm.init(problem.stream_seed))
    state = algorithm.init(problem.stream_seed)
    while state.phase == "pilot":
        batch = algorithm.propose(state)
        assert batch is not None
        answer = drive(batch)
        chunk = chunk_of_batch(batch, answer.driven, answer.worker_s, answer.in_sumo)
        tolerance.see(chunk)
        store.append(job.id, "train", batch.iteration, chunk)
        on_chunk(chunk, False)
        state, totals = algorithm.update(state, batch, answer.driven)
        observe(state, training_record(totals, state.rounds[-1].reached, batch.iteration))
    if state.committor is not None:
        store.artefacts.keep(job.id, COMMITTOR, ce.paths.saved(state.committor))
    store.artefacts.keep(job.id, PILOT, algorithm.to_bytes(state))
    return state


def training_record(totals: PathTotals, reached: float, iteration: int) -> ce.TrainingRecord:
    """A round of the pilot as records of searches are."""
    return ce.TrainingRecord(
        iteration=iteration,
        rollouts=totals.begun,
        gamma_k=reached,
        quantile=reached,
        elites=totals.hits,
        ess=(totals.p / totals.std_error) ** 2 if totals.std_error > 0.0 else 0.0,
        max_weight_share=0.0,
        events=totals.hits,
        infinite=0,
        failed=len(totals.failed),
        step=1.0,
        kl=0.0,
        summary={},
    )


def estimation_record(algorithm: PathSampling, state: Any, totals: PathTotals) -> ce.EstimationRecord:
    """The estimate so far."""
    estimate = algorithm.estimate(state)
    return msgspec.structs.replace(record_of(estimate), iteration=totals.iteration, failed=estimate.failed)


def evaluate_paths(
    store: PathSource,
    job: Job,
    workers: int,
    on_chunk: Callable[[Chunk, bool], None],
    observe: Observe,
    max_failed: float,
) -> PathEstimate:
    """Run a job of paths to its end on local workers, from wherever its record stands."""
    problem = Problem(job)
    algorithm = algorithm_of(problem, store.artefacts)
    with PathPool(job, workers, len(algorithm.checkpoints) - 1) as pool:
        state = carry_on(store, problem, algorithm, pool.run, on_chunk, observe, Tolerance(max_failed))
    return algorithm.estimate(state)
