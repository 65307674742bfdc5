"""The graphical lasso for more weights than members (Friedman et al. 2008), by alternating directions (Boyd 2011).

    minimise over positive definite P:  tr(S P) - log det P + penalty * sum of |P_ij| over i != j

S is the members' covariance in coordinates in which every weight has the same scale. With m = 24 members and d = 404
coordinate descent (scikit-learn) does not converge; alternating directions do, as every step keeps P positive definite.
The penalty is the one with the highest cross-validated likelihood.
"""

from dataclasses import dataclass

import numpy as np

RELAXATION = 1.6
TOLERANCE = 1e-3  # of the relative primal and dual residuals


@dataclass(frozen=True)
class Fitted:
    """precision and covariance (d, d) of standardised coordinates; the iterations it took, and whether they ended."""

    precision: np.ndarray
    covariance: np.ndarray
    iterations: int
    converged: bool


def graphical_lasso(
    sample: np.ndarray, penalty: float, start: np.ndarray | None = None, limit: int = 300
) -> Fitted:
    """The lasso's precision for a sample covariance (d, d); `start`: a precision to begin from."""
    d = len(sample)
    sparse = np.diag(1.0 / (np.diag(sample) + 0.1)) if start is None else start.copy()
    dual, step = np.zeros((d, d)), 1.0
    off = ~np.eye(d, dtype=bool)
    iteration, converged = 0, False
    while iteration < limit and not converged:
        iteration += 1
        values, vectors = np.linalg.eigh(step * (sparse - dual) - sample)
        root = (values + np.sqrt(values**2 + 4.0 * step)) / (2.0 * step)
        precision = (vectors * root) @ vectors.T
        mixed = RELAXATION * precision + (1.0 - RELAXATION) * sparse
        before, sparse = sparse, mixed + dual
        sparse[off] = np.sign(sparse[off]) * np.maximum(np.abs(sparse[off]) - penalty / step, 0.0)
        dual += mixed - sparse
        size = float(np.linalg.norm(precision)), float(np.linalg.norm(dual))
        primal = float(np.linalg.norm(precision - sparse)) / size[0]
        change = float(np.linalg.norm(sparse - before)) / max(size[1], 1e-9)
        converged = primal < TOLERANCE and change < TOLERANCE
        if primal > 10.0 * change:
            step, dual = 2.0 * step, dual / 2.0
        elif change > 10.0 * primal:
            step, dual = step / 2.0, 2.0 * dual
    precision = _positive(sparse)
    covariance = np.linalg.inv(precision)
    return Fitted(precision, 0.5 * (covariance + covariance.T), iteration, converged)


def _positive(matrix: np.ndarray) -> np.ndarray:
    """The sparse iterate, whose smallest eigenvalue may be off by the tolerance, made safely positive definite."""
    smallest = np.linalg.eigvalsh(matrix)[0]
    return matrix if smallest > 1e-6 else matrix + (1e-6 - smallest) * np.eye(len(matrix))


def log_likelihood(precision: np.ndarray, rows: np.ndarray) -> float:
    """Mean log density of rows (n, d), centred, up to the constant d log(2 pi) / 2."""
    return float(
        0.5 * np.linalg.slogdet(precision)[1] - 0.5 * np.mean(np.einsum("ni,ij,nj->n", rows, precision, rows))
    )


def cross_validated(z: np.ndarray, penalties: tuple[float, ...], folds: int = 6) -> dict[float, float]:
    """Mean log likelihood of left-out rows of z (m, d) for each penalty, largest first (warm starts)."""
    scores = dict.fromkeys(penalties, 0.0)
    for fold in range(folds):
        out = np.arange(len(z)) % folds == fold
        rest = z[~out]
        centre = rest.mean(axis=0)
        sample = (rest - centre).T @ (rest - centre) / (len(rest) - 1)
        start = None
        for penalty in sorted(penalties, reverse=True):
            found = graphical_lasso(sample, penalty, start)
            start = found.precision
            scores[penalty] += log_likelihood(found.precision, z[out] - centre) * out.sum() / len(z)
    return scores
