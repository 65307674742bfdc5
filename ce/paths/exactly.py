"""Arithmetic with the same bits on every processor: exp, log and matrix products from nothing but + - * / and
rounding.

NumPy's exp and log, and BLAS, round differently from one processor to the next. What decides whether a path is
split must not. Sums in a product of matrices are exact: both factors are rounded to multiples of a power of two
first, so that no float64 sum of their products is rounded, whatever its order.
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]

# log 2 as a short and a long part: k * _LOG2_HIGH is exact for |k| < 2^20.
_LOG2_HIGH, _LOG2_LOW = 6.93147180369123816490e-01, 1.90821492927058770002e-10
_EXP_TERMS = 14
_LOG_TERMS = 12
# Exponents beyond which exp is 0 or out of range.
_LARGEST = 708.0


def exp(x: ArrayLike) -> Array:
    """e^x within 2 units of the last place; 0 below -708, e^708 above.

    >>> float(exp(0.0)), float(exp(-1000.0)), abs(float(exp(1.0)) - 2.718281828459045) < 1e-15
    (1.0, 0.0, True)
    """
    x = np.asarray(x, dtype=np.float64)
    within = np.clip(x, -_LARGEST, _LARGEST)
    k = np.rint(within / (_LOG2_HIGH + _LOG2_LOW))
    r = (within - k * _LOG2_HIGH) - k * _LOG2_LOW
    total = np.ones_like(r)
    for n in range(_EXP_TERMS, 0, -1):
        total = 1.0 + total * r / n
    return np.where(x < -_LARGEST, 0.0, np.ldexp(total, k.astype(np.int64)))


def log(x: ArrayLike) -> Array:
    """log x within 2 units of the last place for x >= 0; -inf at 0.

    >>> float(log(1.0)), float(log(0.0)), abs(float(log(10.0)) - 2.302585092994046) < 1e-15
    (0.0, -inf, True)
    """
    x = np.asarray(x, dtype=np.float64)
    m, e = np.frexp(x)
    low = m < 0.7071067811865476
    m, k = np.where(low, 2.0 * m, m), np.where(low, e - 1, e).astype(np.float64)
    s = (m - 1.0) / (m + 1.0)
    z = s * s
    total = np.zeros_like(z)
    for n in range(_LOG_TERMS, -1, -1):
        total = total * z + 1.0 / (2 * n + 1)
    return np.where(x > 0.0, k * _LOG2_HIGH + (2.0 * s * total + k * _LOG2_LOW), -np.inf)


def log_sum_exp(x: Array, axis: int) -> Array:
    """log sum exp over one axis, added up in its order; -inf where every term is."""
    terms = np.moveaxis(np.asarray(x, dtype=np.float64), axis, 0)
    top = terms.max(axis=0)
    base = np.where(np.isfinite(top), top, 0.0)
    total = np.zeros_like(base)
    for term in terms:
        total = total + exp(term - base)
    return base + log(total)


def rounded(x: Array, bits: int) -> Array:
    """x to the nearest multiple of 2^-bits."""
    unit = 2.0**bits
    return np.rint(x * unit) / unit


def product(a: Array, b: Array) -> Array:
    """a @ b for a (n, k) and b (k, l), each first rounded to what keeps every sum exact: 53 bits shared between them.

    The rounding goes by the largest entry of each, so rows are not independent of each other; `rounded` with a
    fixed number of bits, then @, is for where they have to be.
    """
    bits = (52 - int(np.ceil(np.log2(max(a.shape[1], 2))))) // 2
    return _scaled(a, bits) @ _scaled(b, bits)


def _scaled(x: Array, bits: int) -> Array:
    _, e = np.frexp(np.max(np.abs(x), initial=0.0))
    return rounded(x, bits - int(e))
