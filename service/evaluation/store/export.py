"""A record as a table or a Parquet file, a row for each rollout, for whatever reads tables."""

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl

from service.errors import StoreError
from service.evaluation.store.chunk import Chunk, Origin
from service.world.safety.contact import Contact

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
    # of a rollout that ended in a collision, false where it was not recorded how the vehicles touched; null otherwise
    "contact_recorded": pl.Boolean,
    "contact_other": pl.Int32,  # its vehicle's place in the scenario; what follows: service.world.safety.contact
    "contact_mps": pl.Float64,
    "contact_ahead_mps": pl.Float64,
    "contact_left_mps": pl.Float64,
    "contact_ego_side": pl.String,
    "contact_ego_part": pl.String,
    "contact_other_side": pl.String,
    "contact_other_part": pl.String,
    "contact_striking": pl.String,
}


def table_of(
    jobs: Mapping[str, Iterable[tuple[str, int, Chunk, Origin]]], outcomes: Mapping[int, str]
) -> pl.DataFrame:
    """Every rollout of the jobs.

    outcomes: names of the outcome codes
    """
    frames = [_frame(job, *one, outcomes) for job, chunks in jobs.items() for one in chunks]
    return pl.concat(frames) if frames else pl.DataFrame(schema=SCHEMA)


def write_parquet(
    path: Path, jobs: Mapping[str, Iterable[tuple[str, int, Chunk, Origin]]], outcomes: Mapping[int, str]
) -> int:
    """Write every rollout of the jobs; how many there are.

    outcomes: names of the outcome codes
    """
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
            **contact_columns(
                [outcomes.get(code) == "collision" for code in chunk.outcomes.tolist()],
                [(chunk.contacts or {}).get(i) for i in range(n)],
            ),
        },
        schema=SCHEMA,
    )


def contact_columns(touched: Sequence[bool], contacts: Sequence[Contact | None]) -> dict[str, list[Any]]:
    """The columns that say how the ego and another vehicle touched.

    touched: which rollouts ended in a collision
    contacts: as they are on record, a rollout each
    """
    columns: dict[str, list[Any]] = {
        "contact_recorded": [c is not None if hit else None for hit, c in zip(touched, contacts, strict=True)]
    }
    for name in Contact.__struct_fields__:
        column = f"contact_{name.removeprefix('speed_')}"
        columns[column] = [None if c is None else getattr(c, name) for c in contacts]
    return columns
