"""The direction in which f falls, by least squares over a whole batch, not only over its elites.

For f = g(b . u) and normal u, least squares of f on u points along b whatever g is (Brillinger, 1982, in A Festschrift
for Erich L. Lehmann; Li and Duan, Annals of Statistics 17, 1989), and where f is nearly linear its error is that of the
residuals alone: in hundreds of dimensions far below the noise of a mean over the elites.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve, solve_triangular

Array = NDArray[np.float64]

# Dimensions, above which the regression would cost more than it gains.
LARGEST = 1000
# Rows a dimension, at least.
ROWS_A_DIMENSION = 1.3
# Squared cosine between the direction found and the true one, estimated, below which it is dropped.
LEAST_COSINE2 = 0.4


@dataclass(frozen=True)
class Direction:
    """A direction in which f falls.

    vector: (d,), of unit length, downhill
    influence: (n,), what each row's own residual adds to its projection, 0 where that was not asked for
    cosine2: estimated squared cosine with the true direction, in [0, 1]
    """

    vector: Array
    influence: Array
    cosine2: float


def downhill(u: Array, f: Array, influence_of: NDArray[np.intp] | None = None) -> Direction | None:
    """The direction for rows u (n, d) with values f (n,), which may hold NaN and infinities; None for none found.

    influence_of: the rows whose influence is wanted (None: all of them), which is most of the work
    """
    n, d = u.shape
    rows = np.flatnonzero(np.isfinite(f))
    m = rows.size
    if d > LARGEST or m < ROWS_A_DIMENSION * d + 30 or np.ptp(f[rows]) == 0.0:
        return None
    x, y = u[rows], f[rows]
    x = x - x.mean(axis=0)
    gram = x.T @ x
    gram[np.diag_indices(d)] += 1e-9 * np.trace(gram) / d
    try:
        factor = cho_factor(gram, lower=True)
    except np.linalg.LinAlgError:
        return None
    best: tuple[float, Array, Array] | None = None
    for clip in (1.0, 0.5):  # f as it is; f where it is low, level above
        values = np.minimum(y, np.quantile(y, clip))
        values = values - values.mean()
        total = float(values @ values)
        if not (total > 0.0 and math.isfinite(total)):
            continue
        slope = cho_solve(factor, x.T @ values)
        residual = values - x @ slope
        explained = 1.0 - float(residual @ residual) / total * (m - 1) / max(m - d - 1, 1)
        cosine2 = explained / (explained + max(1.0 - explained, 0.0) * d / (m - d)) if explained > 0 else 0.0
        if best is None or cosine2 > best[0]:
            best = cosine2, slope, residual
    if best is None or best[0] < LEAST_COSINE2:
        return None
    cosine2, slope, residual = best
    length = float(np.sqrt(slope @ slope))
    if not length > 0.0:
        return None
    influence = np.zeros(n)
    some = np.arange(m) if influence_of is None else np.flatnonzero(np.isin(rows, influence_of))
    half = solve_triangular(factor[0], x[some].T, lower=True, check_finite=False)
    leverage = np.einsum("in,in->n", half, half) + 1.0 / m
    influence[rows[some]] = -(leverage * residual[some] / np.maximum(1.0 - leverage, 1e-3)) / length
    return Direction(-slope / length, influence, cosine2)
