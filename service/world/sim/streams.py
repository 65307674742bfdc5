"""The random numbers of a segment: those of numpy's Philox keyed by the segment's key, as compiled code.

Philox 4x64 with ten rounds (Salmon et al., SC 2011). A segment of some steps takes a few words for the causes that are
drawn anew, three a vehicle, then one word for each standard normal of its steps, as `action_noise` of
`service.world.sim.world` does for a whole rollout: drivers without causes have the noise of the rollout with that seed.
"""

import numpy as np

from policies.exactmath import normal_quantile
from policies.jit import kernel
from service.world.scenario.noise import PathNoise

_M0, _M1 = np.uint64(0xD2E7470EE14C6C93), np.uint64(0xCA5A826395121157)
_W0, _W1 = np.uint64(0x9E3779B97F4A7C15), np.uint64(0xBB67AE8584CAA73B)
_LOW, _32, _12 = np.uint64(0xFFFFFFFF), np.uint64(32), np.uint64(12)
_ZERO = np.uint64(0)
REDRAWN = 3  # causes of a vehicle that a segment draws anew: onset, duration, leak
ROUNDS = 10
CELL = 2.220446049250313e-16  # 2^-52


@kernel
def _high(a: np.uint64, b: np.uint64) -> np.uint64:
    """The upper half of a product of 64-bit words."""
    a0, a1, b0, b1 = a & _LOW, a >> _32, b & _LOW, b >> _32
    low = a0 * b0
    middle = a1 * b0 + (low >> _32)
    other = a0 * b1 + (middle & _LOW)
    return a1 * b1 + (middle >> _32) + (other >> _32)


@kernel
def words(key: np.uint64, out: np.ndarray) -> None:
    """Fill `out` (n,) uint64 with the words of `numpy.random.Philox(key=key)`."""
    for block in range((out.size + 3) // 4):
        c0, c1, c2, c3 = np.uint64(block + 1), _ZERO, _ZERO, _ZERO
        k0, k1 = key, _ZERO
        for _ in range(ROUNDS):
            h0, h1 = _high(_M0, c0), _high(_M1, c2)
            l0, l1 = _M0 * c0, _M1 * c2
            c0, c1, c2, c3 = h1 ^ c1 ^ k0, l1, h0 ^ c3 ^ k1, l0
            k0, k1 = k0 + _W0, k1 + _W1
        at = 4 * block
        out[at] = c0
        if at + 1 < out.size:
            out[at + 1] = c1
        if at + 2 < out.size:
            out[at + 2] = c2
        if at + 3 < out.size:
            out[at + 3] = c3


@kernel
def uniform(word: np.uint64) -> float:
    """A number in (0, 1): the centre of one of 2^52 equal cells."""
    return (np.float64(word >> _12) + 0.5) * CELL


@kernel
def fill_normals(words_: np.ndarray, out: np.ndarray) -> None:
    """Fill `out` (steps, vehicles, channels) with standard normals, one of each word."""
    flat = out.reshape(out.size)
    for i in range(flat.size):
        flat[i] = normal_quantile(uniform(words_[i]))


@kernel
def _fill(key: np.uint64, skipped: int, out: np.ndarray) -> None:
    drawn = np.empty(skipped + out.size, np.uint64)
    words(key, drawn)
    fill_normals(drawn[skipped:], out)


def normals_of(noise: PathNoise, steps: int, vehicles: int, channels: int) -> np.ndarray:
    """All standard normals (steps, vehicles, channels) of a path."""
    skipped = REDRAWN * vehicles if channels > 2 else 0
    out = np.empty((steps, vehicles, channels))
    for begin, end, key in zip(noise.begins, (*noise.begins[1:], steps), noise.keys, strict=True):
        _fill(np.uint64(key), skipped, out[begin:end])
    return out
