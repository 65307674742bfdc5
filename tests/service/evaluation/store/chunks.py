"""Chunks with every kind of value in them, the same for the same place and seed."""

from __future__ import annotations

import numpy as np

from service.evaluation.store import FAILED, Chunk


def chunk(start: int, n: int, seed: int = 0) -> Chunk:
    g = np.random.default_rng((seed, start))
    f = g.normal(size=n)
    f[0] = [np.nan, np.inf, 5e-324, -0.0][start % 4]
    errors = {0: "EgoError: täuscht\n'quoted' \x00"} if start % 4 == 0 else {}
    outcomes = g.integers(0, 5, n).astype(np.uint8)
    outcomes[0] = FAILED if errors else outcomes[0]
    return Chunk(start, start + n, f, outcomes, g.integers(0, 4000, n).astype(np.int32), errors, 0.25)
