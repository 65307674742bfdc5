"""Sensor noise, and numbers drawn from a rollout's seed."""

import numpy as np

from policies.exactmath import normals_from_bits
from policies.jit import bare

NOISE = 1 << 18  # length of the table of standard normals
NOISE_SCALE = 32  # its entries are int16 of this many to a standard deviation


def noise_table() -> np.ndarray:
    """Standard normals (NOISE,) int16, NOISE_SCALE to a standard deviation."""
    values = np.empty(NOISE)
    normals_from_bits(np.random.Philox(key=7).random_raw(NOISE), values)
    return np.round(values * NOISE_SCALE).astype(np.int16)


@bare
def mixed(a: int, b: int, c: int) -> int:
    """A number in [0, 2^31) from three."""
    h = np.uint64(a) * np.uint64(0x9E3779B97F4A7C15) + np.uint64(b) * np.uint64(0xC2B2AE3D27D4EB4F)
    h ^= np.uint64(c) * np.uint64(0x165667B19E3779F9)
    h ^= h >> np.uint64(31)
    h *= np.uint64(0xBF58476D1CE4E5B9)
    h ^= h >> np.uint64(29)
    return int(h & np.uint64(0x7FFFFFFF))


@bare
def add_noise(values: np.ndarray, table: np.ndarray, levels: float, seed: int, frame: int) -> None:
    """Add sensor noise of `levels` (of 255) to the picture `values` (h, 3 w) uint8, in place.

    A row's noise is a stretch of the table that begins at a place drawn from (seed, frame, row).
    """
    h, w = values.shape
    factor = np.int32(levels * 256.0 / NOISE_SCALE + 0.5)
    half, eight = np.int32(128), np.int32(8)
    for y in range(h):
        begin = mixed(seed, frame, y) % (NOISE - w)
        for x in range(w):
            value = np.int32(values[y, x]) + ((np.int32(table[begin + x]) * factor + half) >> eight)
            values[y, x] = min(max(value, np.int32(0)), np.int32(255))
