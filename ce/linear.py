"""Dense linear algebra whose bits depend on neither the processor nor the number of threads.

A rollout's x must be the same on every machine (it decides f), and a BLAS sums in an order that depends on
both. The factorisation and the solves here are elementwise numpy (each operation correctly rounded, no fused
multiply-add); the one large product is split so that BLAS makes no rounding error at all, hence none that
depends on the order (Ozaki, Ogita, Oishi and Rump, Numerical Algorithms 59, 2012).
"""

import math

import numpy as np
from numpy.typing import NDArray

from ce.errors import FamilyError

Array = NDArray[np.float64]


def cholesky(matrix: Array) -> Array:
    """Lower factor L, (d, d), of a symmetric positive definite matrix = L L^T.

    Raises FamilyError where a pivot falls below d * 2.2e-16 of the largest diagonal entry.
    """
    rest = np.array(matrix, dtype=np.float64)
    d = rest.shape[0]
    lower = np.zeros((d, d))
    least = d * np.finfo(np.float64).eps * float(np.max(np.diagonal(rest)))
    for j in range(d):
        pivot = rest[j, j]
        if not pivot > max(least, 0.0):
            raise FamilyError(
                f"the covariance is not positive definite: pivot {j} is {pivot:.3g}; "
                "give a symmetric positive definite matrix (add to its diagonal, or drop dependent "
                "coordinates)"
            )
        column = rest[j:, j] / np.sqrt(pivot)
        lower[j:, j] = column
        rest[j + 1 :, j + 1 :] -= column[1:, None] * column[None, 1:]
    return lower


def solve(lower: Array, right: Array) -> Array:
    """(L L^T)^{-1} right for right of shape (d,), by substitution."""
    y = np.array(right, dtype=np.float64)
    d = y.size
    for j in range(d):
        y[j] /= lower[j, j]
        y[j + 1 :] -= lower[j + 1 :, j] * y[j]
    for j in range(d - 1, -1, -1):
        y[j] /= lower[j, j]
        y[:j] -= lower[j, :j] * y[j]
    return y


class Correlator:
    """z -> z L^T for standard normal z (n, d), exact to about 1e-12 and the same bits everywhere.

    z and the rows of L are cut into two slices of b bits each, 2 b + log2 d <= 53, so that the products of
    slices and their sums are exact in float64 whatever the order. Rows of z are independent of one another.
    """

    # No normal drawn by a ziggurat in float64 comes near it.
    _Z_BOUND = 16.0

    def __init__(self, lower: Array) -> None:
        d = lower.shape[0]
        self._bits = (53 - math.ceil(math.log2(max(d, 2)))) // 2
        _, exponent = np.frexp(np.abs(lower).max(axis=1))
        unit = np.ldexp(1.0, exponent - self._bits)[:, None]
        high = np.rint(lower / unit) * unit
        unit_low = np.ldexp(unit, -self._bits)
        low = np.rint((lower - high) / unit_low) * unit_low
        self._high_t = np.ascontiguousarray(high.T)
        self._low_t = np.ascontiguousarray(low.T)

    def __call__(self, z: Array) -> Array:
        unit = math.ldexp(self._Z_BOUND, -self._bits)
        high = np.rint(z / unit) * unit
        unit_low = math.ldexp(unit, -self._bits)
        low = np.rint((z - high) / unit_low) * unit_low
        x: Array = (high @ self._high_t + (high @ self._low_t + low @ self._high_t)) + low @ self._low_t
        return x
