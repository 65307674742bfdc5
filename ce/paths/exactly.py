"""Arithmetic with the same bits on every processor: exp, log and matrix products from nothing but + - * / and
rounding.

NumPy's exp and log, and BLAS, round differently from one processor to the next. What decides whether a path is
split must not. Sums in a product of matrices are exact: both factors are rounded to multiples of a power of two
first, so that no float64 sum of their products is rounded, whatever its order.
"""

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]

# log 2 as a short and a long part: k * _LOG2_HIGH is exact for |k| < 2^20.
_LOG2_HIGH, _LOG2_LOW = 6.93147180369123816490e-01, 1.90821492927058770002e-10
_OF_LOG2 = 1.44269504088896338700e00
# 1 / n! for n from 13 down to 1.
_EXP_SERIES = tuple(1.0 / math.factorial(n) for n in range(13, 0, -1))
# 1 / (2 n + 1) for n from 12 down to 1.
_LOG_SERIES = tuple(1.0 / (2 * n + 1) for n in range(12, 0, -1))
# Exponents beyond which exp is 0 or out of range.
_LARGEST = 708.0


def exp(x: ArrayLike) -> Array:
    """e^x within 2 units of the last place; 0 below -708, e^708 above.

    >>> float(exp(0.0)), float(exp(-1000.0)), abs(float(exp(1.0)) - 2.718281828459045) < 1e-15
    (1.0, 0.0, True)
    """
    x = np.asarray(x, dtype=np.float64)
    r = np.atleast_1d(np.clip(x, -_LARGEST, _LARGEST))
    k = np.rint(r * _OF_LOG2)
    r -= k * _LOG2_HIGH
    r -= k * _LOG2_LOW
    total = r * _EXP_SERIES[0]
    for coefficient in _EXP_SERIES[1:]:
        total += coefficient
        total *= r
    total += 1.0
    np.ldexp(total, k.astype(np.int32), out=total)
    total[np.atleast_1d(x < -_LARGEST)] = 0.0
    return np.asarray(total.reshape(x.shape))


def log(x: ArrayLike) -> Array:
    """log x within 2 units of the last place for x >= 0; -inf at 0.

    >>> float(log(1.0)), float(log(0.0)), abs(float(log(10.0)) - 2.302585092994046) < 1e-15
    (0.0, -inf, True)
    """
    x = np.asarray(x, dtype=np.float64)
    m, e = np.frexp(np.atleast_1d(x))
    low = m < 0.7071067811865476
    k = e - low.astype(np.float64)
    m = np.where(low, 2.0 * m, m)
    s = (m - 1.0) / (m + 1.0)
    z = s * s
    total = z * _LOG_SERIES[0]
    for coefficient in _LOG_SERIES[1:]:
        total += coefficient
        total *= z
    total += 1.0
    total *= s
    total *= 2.0
    total += k * _LOG2_LOW
    total += k * _LOG2_HIGH
    total[~(np.atleast_1d(x) > 0.0)] = -np.inf
    return np.asarray(total.reshape(x.shape))


def log_sum_exp(x: Array, axis: int) -> Array:
    """log sum exp over one axis, added up in its order; -inf where every term is."""
    terms = np.moveaxis(np.asarray(x, dtype=np.float64), axis, 0)
    top = terms.max(axis=0)
    base = np.where(np.isfinite(top), top, 0.0)
    return np.asarray(base + log(added(exp(terms - base))))


def added(terms: Array) -> Array:
    """Sum over the first axis, in its order."""
    total: Array = terms[0].copy()
    for term in terms[1:]:
        total += term
    return total


def rounded(x: Array, bits: int, out: Array | None = None) -> Array:
    """x, below 2^(51 - bits) in size, to the nearest multiple of 2^-bits; `out` may be x itself.

    >>> import numpy as np
    >>> rounded(np.array([0.3, -0.3]), 2)
    array([ 0.25, -0.25])
    """
    shift = 1.5 * 2.0 ** (52 - bits)  # what is added has no bits below 2^-bits, so that the sum loses them
    out = np.add(x, shift, out=out)
    out -= shift
    return out


def product(a: Array, b: Array) -> Array:
    """a @ b for a (n, k) and b (k, l), each first rounded to what keeps every sum exact: 53 bits shared between them.

    The rounding goes by the largest entry of each, so rows are not independent of each other; `rounded` with a
    fixed number of bits, then @, is for where they have to be.
    """
    bits = (52 - int(np.ceil(np.log2(max(a.shape[1], 2))))) // 2
    return scaled(a, bits) @ scaled(b, bits)


def scaled(x: Array, bits: int) -> Array:
    """x to the nearest multiple of 2^(e - bits), 2^e above its largest entry."""
    _, e = np.frexp(np.max(np.abs(x), initial=0.0))
    return rounded(x, bits - int(e))
