"""Digests of what rollouts are drawn: x and the noise seeds, row by row, against accidents and not against forgers."""

import numpy as np


def row_hashes(x: np.ndarray, noise_seeds: np.ndarray) -> np.ndarray:
    """A 64-bit number for each row of x (n, d) and noise seed (n,), that differs where a bit differs."""
    multipliers = (
        np.random.Generator(np.random.Philox(x.shape[1])).bit_generator.random_raw(x.shape[1] + 1) | 1
    )
    words = np.ascontiguousarray(x, dtype="<f8").view(np.uint64)
    sums = np.empty(len(noise_seeds), dtype=np.uint64)
    for first in range(0, len(noise_seeds), 256):  # a few rows at a time stay in the cache
        part = slice(first, first + 256)
        mixed = words[part] ^ (words[part] >> np.uint64(32))
        sums[part] = (mixed * multipliers[:-1]).sum(axis=1, dtype=np.uint64)
    return sums + noise_seeds.astype(np.uint64) * multipliers[-1]


def rows_digest(hashes: np.ndarray) -> str:
    """One digest for some rows' hashes, in their order."""
    places = np.arange(1, 2 * hashes.size, 2, dtype=np.uint64) * np.uint64(0x9E3779B97F4A7C15)
    return f"{int((hashes * places).sum(dtype=np.uint64)):016x}"
