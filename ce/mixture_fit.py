"""Weighted EM for the Gaussian mixture of a subspace, its number of components by BIC.

k-means++ seeding (Arthur and Vassilvitskii, SODA 2007); the sample size in BIC is the effective one. Each
covariance is shrunk towards the base's, I, by a prior worth r + 1 samples, and contracted directions are
widened afterwards: tails lighter than the event's give weights without a variance.
"""

import math

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp

from ce.gaussian_mixture import Part, log_normal
from ce.subspace import find

Array = NDArray[np.float64]

_ITERATIONS = 20
_COUNTS = (1, 2, 3, 4, 6, 8, 12)
WIDENING = 1.3  # factor on variances below the base's, at most up to it


def fit(u: Array, w: Array, most_components: int, source: np.random.Generator) -> Part:
    """The part (weight 1) that fits samples u (n, d) with weights w (n,) that sum to one."""
    space = find(u, w)
    y, r = space.y, space.basis.shape[1]
    ess = 1.0 / float(np.sum(w * w))
    best: tuple[float, Array, Array, Array] | None = None
    worse = 0
    for k in _COUNTS if r else (1,):
        if k > most_components or (k > 1 and ess < 8.0 * k):
            break
        seeds = _seeded(y, w, k, source)
        trials = [_em(y, w, seeds, ess, diagonal) for diagonal in ((False, True) if r > 1 else (False,))]
        trial = max(trials, key=lambda t: t[0])
        if best is None or trial[0] > best[0]:
            best, worse = trial, 0
        else:
            worse += 1
            if worse == 2:
                break
    assert best is not None
    _, shares, means, covariances = best
    factors = np.stack([np.linalg.cholesky(_widened(c)) for c in covariances])
    return Part(1.0, space.basis, shares, means, factors, space.scale)


def _widened(covariance: Array) -> Array:
    values, vectors = np.linalg.eigh(covariance)
    values = np.where(values < 1.0, np.minimum(WIDENING * values, 1.0), values)
    return (vectors * values) @ vectors.T


def _seeded(y: Array, w: Array, k: int, source: np.random.Generator) -> Array:
    """Responsibilities (n, k), one-hot, of the best of three k-means++ runs."""
    n = y.shape[0]
    best, best_inertia = np.ones((n, 1)), math.inf
    if k == 1:
        return best
    for _ in range(3):
        centres = y[[int(np.searchsorted(np.cumsum(w), source.random() * w.sum()).clip(0, n - 1))]]
        while centres.shape[0] < k:
            mass = np.cumsum(w * _distances(y, centres).min(axis=1))
            at = int(np.searchsorted(mass, source.random() * mass[-1]).clip(0, n - 1))
            centres = np.vstack([centres, y[at]])
        for _ in range(8):
            label = _distances(y, centres).argmin(axis=1)
            for j in range(k):
                mine = label == j
                if w[mine].sum() > 0:
                    centres[j] = w[mine] @ y[mine] / w[mine].sum()
        distances = _distances(y, centres)
        inertia = float(w @ distances.min(axis=1))
        if inertia < best_inertia:
            best, best_inertia = np.eye(k)[distances.argmin(axis=1)], inertia
    return best


def _distances(y: Array, centres: Array) -> Array:
    squares = np.sum(y * y, axis=1)[:, None] - 2.0 * y @ centres.T + np.sum(centres * centres, axis=1)
    return np.maximum(squares, 0.0)


def _em(
    y: Array, w: Array, responsibility: Array, ess: float, diagonal: bool
) -> tuple[float, Array, Array, Array]:
    """BIC (higher is better), shares, means, covariances."""
    r, k = y.shape[1], responsibility.shape[1]
    identity = np.eye(r)
    previous = -math.inf
    for _ in range(_ITERATIONS):
        mass = w[:, None] * responsibility
        shares = mass.sum(axis=0)
        shares = np.maximum(shares, 1e-10) / np.maximum(shares, 1e-10).sum()
        means, covariances = np.zeros((k, r)), np.zeros((k, r, r))
        for j in range(k):
            own = mass[:, j] / max(mass[:, j].sum(), 1e-300)
            count = mass[:, j].sum() ** 2 / max(float(np.sum(mass[:, j] ** 2)), 1e-300)
            means[j] = own @ y
            centred = y - means[j]
            if diagonal:
                spread = np.diag(own @ (centred * centred))
                prior = 2.0
            else:
                spread = (own[:, None] * centred).T @ centred
                prior = r + 1.0
            covariances[j] = (count * spread + prior * identity) / (count + prior)
        logs = np.stack(
            [
                math.log(s) + log_normal(y, m, np.asarray(np.linalg.cholesky(c), dtype=np.float64))
                for s, m, c in zip(shares, means, covariances, strict=True)
            ],
            axis=1,
        )
        total = logsumexp(logs, axis=1)
        likelihood = float(w @ total)
        if k == 1 or likelihood - previous < 1e-4:
            break
        previous = likelihood
        responsibility = np.exp(logs - total[:, None])
    parameters = k * (r + (r if diagonal else r * (r + 1) // 2)) + k - 1
    return ess * likelihood - 0.5 * parameters * math.log(max(ess, 2.0)), shares, means, covariances
