"""Sensor noise, and numbers drawn from a rollout's seed."""

import numpy as np

from policies.exactmath import normals_from_bits
from policies.jit import bare

TABLE_SIZE = 1 << 18  # length of the table of standard normals
TABLE_SCALE = 32  # its entries are int16 of this many to a standard deviation


def sensor_noise_table() -> np.ndarray:
    """Standard normals (TABLE_SIZE,) int16, TABLE_SCALE to a standard deviation."""
    values = np.empty(TABLE_SIZE)
    normals_from_bits(np.random.Philox(key=7).random_raw(TABLE_SIZE), values)
    return np.round(values * TABLE_SCALE).astype(np.int16)


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
def add_sensor_noise(values: np.ndarray, table: np.ndarray, levels: float, seed: int, frame: int) -> None:
    """Add sensor noise of `levels` (of 255) to the picture `values` (h, 3 w) uint8, in place.

    A row's noise is a stretch of the table that begins at a place drawn from (seed, frame, row).
    """
    h, w = values.shape
    factor = np.int32(levels * 256.0 / TABLE_SCALE + 0.5)
    half, eight = np.int32(128), np.int32(8)
    for y in range(h):
        begin = mixed(seed, frame, y) % (TABLE_SIZE - w)
        for x in range(w):
            value = np.int32(values[y, x]) + ((np.int32(table[begin + x]) * factor + half) >> eight)
            values[y, x] = min(max(value, np.int32(0)), np.int32(255))
