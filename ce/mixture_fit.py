"""Weighted EM for the Gaussian mixture of a subspace, its number of components by BIC.

k-means++ seeding (Arthur and Vassilvitskii, SODA 2007); the sample size in BIC is the effective one. Each
covariance is shrunk towards the base's, I, by a prior worth r + 1 samples, and contracted directions are
widened afterwards: tails lighter than the event's give weights without a variance.
"""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp

from ce.gaussian_mixture import Part, log_normal
from ce.regression import Direction
from ce.subspace import find

Array = NDArray[np.float64]

_ITERATIONS = 20
PATIENCE = 4  # numbers of components without a gain after which no larger one is tried
MOST_SAMPLES = 4000  # that EM goes over, a random choice of them
_COUNTS = (1, 2, 3, 4, 6, 8, 12)
FEW = 3  # dimensions
FORMS = ("full", "diagonal", "spiked")
WIDENING = 1.3  # factor on variances below the base's, at most up to it


def fit(
    u: Array,
    w: Array,
    most_components: int,
    source: np.random.Generator,
    hints: Sequence[Direction] = (),
    worth: float = math.inf,
) -> Part:
    """The part (weight 1) that fits samples u (n, d) with weights w (n,) that sum to one; the rest as in `find`."""
    space = find(u, w, hints, worth)
    y, r = space.y, space.basis.shape[1]
    ess = min(1.0 / float(np.sum(w * w)), worth)
    if y.shape[0] > MOST_SAMPLES:
        some = source.permutation(y.shape[0])[:MOST_SAMPLES]
        y, w = y[some], w[some] / w[some].sum()
        ess = min(ess, 1.0 / float(np.sum(w * w)))
    best: tuple[float, Array, Array, Array] | None = None
    worse = 0
    for k in _COUNTS if r else (1,):
        if k > most_components or (k > 1 and ess < 8.0 * k):
            break
        seeds = _seeded(y, w, k, source)
        trial = _best(y, w, seeds, ess)
        if best is None or trial[0] > best[0]:
            best, worse = trial, 0
        else:
            worse += 1
            if worse == PATIENCE:
                break
    assert best is not None
    _, shares, means, covariances = best
    factors = np.stack([np.linalg.cholesky(_widened(c)) for c in covariances])
    return Part(1.0, space.basis, shares, means, factors, space.scale)


def fit_clusters(
    u: Array, chains: NDArray[np.intp], most_components: int, source: np.random.Generator, worth: float
) -> Part:
    """The part (weight 1) that fits states u (n, d) of several chains (n,), which may sit in different modes.

    Above FEW dimensions the directions are those of the modes' means, which cost d numbers a mode, and covariances are
    the base's but for the direction of the mean: so few independent states (`worth`) say no more. Modes are told apart
    by the chains' mean directions (spherical k-means), their number by BIC.
    """
    n, d = u.shape
    equal = np.full(n, 1.0 / n)
    if d <= FEW:
        return fit(u, equal, most_components, source, worth=worth)
    names, inverse = np.unique(chains, return_inverse=True)
    averages = np.stack([u[inverse == j].mean(axis=0) for j in range(names.size)])
    unit = averages / np.maximum(np.sqrt(np.sum(averages**2, axis=1, keepdims=True)), 1e-300)
    best: tuple[float, Part] | None = None
    for k in _COUNTS:
        if k > most_components or (k > 1 and names.size < 3 * k):
            break
        label = (_seeded(unit, np.full(names.size, 1.0 / names.size), k, source)).argmax(axis=1)[inverse]
        labels = [j for j in range(k) if np.any(label == j)]
        means = []
        for j in labels:
            mean = u[label == j].mean(axis=0)
            noise = d / (worth * float(np.mean(label == j)))
            means.append(mean * max(1.0 - noise / max(float(mean @ mean), 1e-300), 0.1))
        basis = np.linalg.qr(np.stack(means, axis=1))[0]
        y = u @ basis
        for j, mean in zip(labels, means, strict=True):  # as far from the base as the shrunken mean
            y[label == j] += mean @ basis - y[label == j].mean(axis=0)
        score, shares, centres, covariances = _em(y, equal, np.eye(k)[:, labels][label], worth, "spiked")
        # Against the base, so that bases of different size compare; a direction costs d numbers.
        score += worth * 0.5 * float(np.mean(np.sum(y * y, axis=1))) - 0.5 * d * len(labels) * math.log(
            max(worth, 2.0)
        )
        if best is None or score > best[0]:
            factors = np.stack([np.linalg.cholesky(_widened(c)) for c in covariances])
            best = score, Part(1.0, basis, shares, centres, factors, 1.0)
    assert best is not None
    return best[1]


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


def _best(y: Array, w: Array, seeds: Array, ess: float) -> tuple[float, Array, Array, Array]:
    """Of the forms that the covariances may have."""
    forms = FORMS if y.shape[1] > 1 else ("full",)
    return max((_em(y, w, seeds, ess, form) for form in forms), key=lambda t: t[0])


def _covariance(form: str, centred: Array, own: Array, count: float, mean: Array) -> Array:
    """Of one component with samples `centred` (n, r), weights own (n,) that sum to one and are worth `count`."""
    identity = np.eye(mean.size)
    if form == "spiked":  # as the base's but for the direction of the mean, where an event cuts
        length2 = float(mean @ mean)
        if not length2 > 0:
            return identity
        along = centred @ mean
        spread = float(own @ (along * along)) / length2
        shrunk = (count * spread + 2.0) / (count + 2.0)
        return identity + (shrunk - 1.0) * np.outer(mean, mean) / length2
    if form == "diagonal":
        return (count * np.diag(own @ (centred * centred)) + 2.0 * identity) / (count + 2.0)
    prior = mean.size + 1.0
    return (count * ((own[:, None] * centred).T @ centred) + prior * identity) / (count + prior)


def _em(
    y: Array, w: Array, responsibility: Array, ess: float, form: str
) -> tuple[float, Array, Array, Array]:
    """BIC (higher is better), shares, means, covariances."""
    r, k = y.shape[1], responsibility.shape[1]
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
            covariances[j] = _covariance(form, y - means[j], own, count, means[j])
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
    spread = {"full": r * (r + 1) // 2, "diagonal": r, "spiked": 1}[form]
    parameters = k * (r + spread) + k - 1
    return ess * likelihood - 0.5 * parameters * math.log(max(ess, 2.0)), shares, means, covariances
