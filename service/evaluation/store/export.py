"""A record as a table or a Parquet file, a row for each rollout, for whatever reads tables."""

from collections.abc import Iterable, Mapping
from pathlib import Path

import numpy as np
import polars as pl

from service.errors import StoreError
from service.evaluation.store.chunk import Chunk, Origin

SCHEMA = {
    "job": pl.String,
    "phase": pl.String,  # of the method: train or estimate
    "iteration": pl.Int32,
    "row": pl.Int64,  # of the batch stream (phase, iteration)
    "f": pl.Float64,  # the safety value, null where the rollout failed
    "outcome": pl.String,
    "steps": pl.Int32,
    "error": pl.String,
    "worker": pl.String,  # null for a local process
}


def table_of(
    jobs: Mapping[str, Iterable[tuple[str, int, Chunk, Origin]]], outcomes: Mapping[int, str]
) -> pl.DataFrame:
    """Every rollout of the jobs. outcomes: names of the outcome codes."""
    frames = [_frame(job, *one, outcomes) for job, chunks in jobs.items() for one in chunks]
    return pl.concat(frames) if frames else pl.DataFrame(schema=SCHEMA)


def write_parquet(
    path: Path, jobs: Mapping[str, Iterable[tuple[str, int, Chunk, Origin]]], outcomes: Mapping[int, str]
) -> int:
    """Write every rollout of the jobs; how many there are. outcomes: names of the outcome codes."""
    table = table_of(jobs, outcomes)
    try:
        table.write_parquet(path, compression="zstd")
    except OSError as error:
        raise StoreError(f"cannot write {path}: {error}") from error
    return table.height


def _frame(
    job: str, phase: str, iteration: int, chunk: Chunk, origin: Origin, outcomes: Mapping[int, str]
) -> pl.DataFrame:
    n = chunk.stop - chunk.start
    return pl.DataFrame(
        {
            "job": [job] * n,
            "phase": [phase] * n,
            "iteration": [iteration] * n,
            "row": np.arange(chunk.start, chunk.stop),
            "f": pl.Series(chunk.f).fill_nan(None),
            "outcome": [outcomes.get(code, f"code {code}") for code in chunk.outcomes.tolist()],
            "steps": chunk.steps,
            "error": [chunk.errors.get(i) for i in range(n)],
            "worker": [origin.worker or None] * n,
        },
        schema=SCHEMA,
    )
