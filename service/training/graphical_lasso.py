"""The graphical lasso for more weights than members (Friedman et al. 2008), by proximal gradients (Guillot 2012).

    minimise over positive definite P:  tr(S P) - log det P + penalty * sum of |P_ij| over i != j

S is the members' covariance in coordinates in which every weight has the same scale. With m = 24 members and d = 404
coordinate descent (scikit-learn) does not converge; here every accepted step keeps P positive definite. The penalty is
the one with the highest cross-validated likelihood.
"""

from dataclasses import dataclass

import numpy as np
from scipy.linalg.lapack import dpotrf, dpotri

TOLERANCE = 2e-3  # of the proximal gradient, relative to the sample covariance
SHRINK = 0.5  # of a step that was too long


@dataclass(frozen=True)
class Fitted:
    """precision and covariance (d, d) of standardised coordinates; the iterations it took, and whether they ended."""

    precision: np.ndarray
    covariance: np.ndarray
    iterations: int
    converged: bool


def graphical_lasso(
    sample: np.ndarray,
    penalty: float,
    start: np.ndarray | None = None,
    limit: int = 200,
    tolerance: float = TOLERANCE,
) -> Fitted:
    """The lasso's precision for a sample covariance (d, d); `start`: a precision to begin from."""
    precision = np.diag(1.0 / np.diag(sample)) if start is None else start
    covariance, log_det = _inverse(precision) or (np.eye(len(sample)), 0.0)
    value = np.sum(sample * precision) - log_det
    step, iteration, converged = 1.0, 0, False
    wanted = tolerance * float(np.linalg.norm(sample))
    while iteration < limit and not converged:
        iteration += 1
        gradient = sample - covariance
        while True:
            new = _soft(precision - step * gradient, step * penalty)
            change = new - precision
            size = float(np.sum(change**2))
            found = _inverse(new)
            if found is not None:
                new_value = np.sum(sample * new) - found[1]
                if new_value <= value + np.sum(gradient * change) + size / (2.0 * step) + 1e-9 * abs(value):
                    break
            step *= SHRINK
        curvature = float(np.sum(change * (covariance - found[0])))
        converged = bool(np.sqrt(size) / step < wanted)
        precision, covariance, value = new, found[0], new_value
        step = min(max(size / curvature if curvature > 0.0 else step, 1e-4), 1e4)  # Barzilai and Borwein's
    return Fitted(precision, covariance, iteration, converged)


def _soft(matrix: np.ndarray, threshold: float) -> np.ndarray:
    """Off-diagonal entries shrunk towards 0."""
    shrunk = np.sign(matrix) * np.maximum(np.abs(matrix) - threshold, 0.0)
    np.fill_diagonal(shrunk, np.diag(matrix))
    return shrunk


def _inverse(matrix: np.ndarray) -> tuple[np.ndarray, float] | None:
    """Inverse and log determinant of a symmetric matrix, None where it is not positive definite."""
    factor, failed = dpotrf(matrix, lower=1)
    if failed:
        return None
    inverse, _ = dpotri(factor, lower=1)
    lower = np.tril(inverse)
    return lower + np.tril(lower, -1).T, float(2.0 * np.log(np.diag(factor)).sum())


def log_likelihood(precision: np.ndarray, rows: np.ndarray) -> float:
    """Mean log density of rows (n, d), centred, up to the constant d log(2 pi) / 2."""
    return float(
        0.5 * np.linalg.slogdet(precision)[1] - 0.5 * np.mean(np.einsum("ni,ij,nj->n", rows, precision, rows))
    )


def cross_validated(
    z: np.ndarray, penalties: tuple[float, ...], floor: np.ndarray | float = 0.0, folds: int = 4
) -> dict[float, float]:
    """Mean log likelihood of left-out rows of z (m, d) for each penalty, largest first (warm starts).

    floor (d, d): covariance that is added to that of the rows, for directions in which they do not vary.
    """
    scores = dict.fromkeys(penalties, 0.0)
    for fold in range(folds):
        out = np.arange(len(z)) % folds == fold
        rest = z[~out]
        centre = rest.mean(axis=0)
        sample = (rest - centre).T @ (rest - centre) / (len(rest) - 1) + floor
        start = None
        for penalty in sorted(penalties, reverse=True):
            found = graphical_lasso(sample, penalty, start)
            start = found.precision
            scores[penalty] += log_likelihood(found.precision, z[out] - centre) * out.sum() / len(z)
    return scores
