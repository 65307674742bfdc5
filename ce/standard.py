"""Standard-normal space: X = T(U) with U ~ N(0, I_d) and T exact for every block of a Product.

A Normal block is mean + L u (L its Cholesky factor), every other coordinate x = F^{-1}(Phi(u)); blocks are
independent, so this is the Rosenblatt transform and no Nataf correlation has to be solved for. Both tails keep
their relative accuracy: the upper half goes through the survival functions. Unlike in `ce.streams.draw`, the
products here leave their rounding to BLAS: x made here travels with its batch.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.special import betainc, betaincc, betainccinv, betaincinv, ndtr, ndtri

from ce.product import Product

Array = NDArray[np.float64]


def from_standard(base: Product, u: Array) -> Array:
    """x (n, d) of u (n, d)."""
    x = np.empty_like(u)
    columns, b = base.beta_columns, base.betas
    if columns.size:
        v = u[:, columns]
        tail = ndtr(-np.abs(v))
        unit = np.empty_like(v)
        for inverse, where in ((betaincinv, v < 0), (betainccinv, v >= 0)):
            which = np.nonzero(where)[1]
            unit[where] = inverse(b.alpha[which], b.beta[which], tail[where])
        x[:, columns] = np.clip(b.low + b.width * unit, b.low, b.high)
    for start, block in base.normals:
        x[:, start : start + block.dim] = block.mean + block.coloured(u[:, start : start + block.dim])
    for column, marginal in base.marginals:
        x[:, column] = marginal.from_standard(u[:, column] + marginal.shift)
    return x


def to_standard(base: Product, x: Array) -> Array:
    """u (n, d) of x (n, d), the inverse of `from_standard` to rounding."""
    x = base.checked(x)
    u = np.empty_like(x)
    columns, b = base.beta_columns, base.betas
    if columns.size:
        unit = b.unit(x[:, columns])
        below, above = betainc(b.alpha, b.beta, unit), betaincc(b.alpha, b.beta, unit)
        u[:, columns] = np.where(below < above, ndtri(below), -ndtri(above))
    for start, block in base.normals:
        part = x[:, start : start + block.dim]
        u[:, start : start + block.dim] = block.whitened(part - block.mean)
    for column, marginal in base.marginals:
        u[:, column] = marginal.to_standard(x[:, column]) - marginal.shift
    return u
