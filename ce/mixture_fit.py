"""Weighted EM for the Gaussian mixture of a subspace, its number of components by BIC.

k-means++ seeding (Arthur and Vassilvitskii, SODA 2007); the sample size in BIC is the effective one. Each
covariance is shrunk towards the base's, I, by a prior worth r + 1 samples, and contracted directions are
widened afterwards: tails lighter than the event's give weights without a variance.
"""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ce.gaussian_mixture import Part
from ce.regression import Direction, downhill
from ce.subspace import find

Array = NDArray[np.float64]

_ITERATIONS = 20
# Nats of the whole likelihood that another iteration must gain.
LEAST_GAIN = 0.2
# Numbers of components without a gain after which no larger one is tried.
PATIENCE = 3
# Samples that EM goes over, a random choice of them.
MOST_SAMPLES = 1200
_COUNTS = (1, 2, 3, 4, 6, 8, 12)
# Dimensions up to which states of chains are fitted as independent samples are.
LOW_DIMENSION = 3
# Cosine between the means of components that may sit in the same mode.
SAME_MODE_COSINE = 0.5
# Squared cosine of a regression with the line that it is about, above which a mean is aligned with it.
ALIGNED_COSINE2 = 0.8
FORMS = ("full", "diagonal", "spiked")
# Factor on variances below the base's, at most up to it.
WIDENING = 1.3


def fit(
    u: Array,
    w: Array,
    most_components: int,
    source: np.random.Generator,
    directions: Sequence[Direction] = (),
    ess_limit: float = math.inf,
) -> Part:
    """The part (weight 1) that fits weighted samples.

    u: (n, d), the samples
    w: (n,), their weights, which sum to one
    most_components: of the fit
    source: of random numbers
    directions: to be kept, best first, each with every sample's influence on it
    ess_limit: effective number of samples at most, where they depend on each other
    """
    space = find(u, w, directions, ess_limit)
    y, r = space.y, space.basis.shape[1]
    ess = min(1.0 / float(np.sum(w * w)), ess_limit)
    if y.shape[0] > MOST_SAMPLES:
        some = source.permutation(y.shape[0])[:MOST_SAMPLES]
        y, w = y[some], w[some] / w[some].sum()
        ess = min(ess, 1.0 / float(np.sum(w * w)))
    best: tuple[float, Array, Array, Array] | None = None
    worse = 0
    forms: tuple[str, ...] = FORMS if r > 1 else ("full",)
    for k in _COUNTS if r else (1,):
        if k > most_components or (k > 1 and ess < 8.0 * k):
            break
        eligible = forms if k == 1 else tuple(form for form in forms if not _too_many(form, k, r, ess))
        if not eligible:
            break
        seeds = _k_means(y, w, k, source)
        trials = {form: _em(y, w, seeds, ess, form) for form in eligible}
        chosen = max(trials, key=lambda form: trials[form][0])
        trial = trials[chosen]
        if k > 1:
            forms = (chosen,)  # of many components as of two
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
    u: Array, chains: NDArray[np.intp], most_components: int, source: np.random.Generator, ess_limit: float
) -> Part:
    """The part (weight 1) that fits states u (n, d) of several chains (n,), which may sit in different modes.

    Above LOW_DIMENSION dimensions the directions are those of the modes' means, which cost d numbers a mode, and
    covariances are the base's but for the direction of the mean: so few independent states say no more. Modes are told
    apart by the chains' mean directions (spherical k-means), their number by BIC.

    u: (n, d), the states
    chains: (n,), number of each one's chain
    most_components: of the fit
    source: of random numbers
    ess_limit: number of independent states that they are worth
    """
    n, d = u.shape
    equal = np.full(n, 1.0 / n)
    if d <= LOW_DIMENSION:
        return fit(u, equal, most_components, source, ess_limit=ess_limit)
    names, inverse = np.unique(chains, return_inverse=True)
    averages = np.stack([u[inverse == j].mean(axis=0) for j in range(names.size)])
    unit = averages / np.maximum(np.sqrt(np.sum(averages**2, axis=1, keepdims=True)), 1e-300)
    best: tuple[float, Part] | None = None
    for k in _COUNTS:
        if k > most_components or (k > 1 and names.size < 3 * k):
            break
        label = (_k_means(unit, np.full(names.size, 1.0 / names.size), k, source)).argmax(axis=1)[inverse]
        labels = [j for j in range(k) if np.any(label == j)]
        means = []
        for j in labels:
            mean = u[label == j].mean(axis=0)
            noise = d / (ess_limit * float(np.mean(label == j)))
            means.append(mean * max(1.0 - noise / max(float(mean @ mean), 1e-300), 0.1))
        basis = np.linalg.qr(np.stack(means, axis=1))[0]
        y = u @ basis
        for j, mean in zip(labels, means, strict=True):  # as far from the base as the shrunken mean
            y[label == j] += mean @ basis - y[label == j].mean(axis=0)
        score, shares, centres, covariances = _em(y, equal, np.eye(k)[:, labels][label], ess_limit, "spiked")
        # Against the base, so that bases of different size compare; a direction costs d numbers.
        score += ess_limit * 0.5 * float(np.mean(np.sum(y * y, axis=1))) - 0.5 * d * len(labels) * math.log(
            max(ess_limit, 2.0)
        )
        if best is None or score > best[0]:
            factors = np.stack([np.linalg.cholesky(_widened(c)) for c in covariances])
            best = score, Part(1.0, basis, shares, centres, factors, 1.0)
    assert best is not None
    return best[1]


def aligned(part: Part, label: NDArray[np.intp], u: Array, f: Array) -> Part:
    """The part with each mean brought back to the line along which f falls, where a regression around it is sure of it.

    The rest of a mean over few chains is noise, which costs weights.

    part: to be aligned
    label: (n,), the component that each row is nearest to, -1 for none of this part
    u: (n, d), the rows
    f: (n,), their values
    """
    means = part.means @ part.basis.T
    unit = means / np.maximum(np.sqrt(np.sum(means**2, axis=1, keepdims=True)), 1e-300)
    same_mode = unit @ unit.T > SAME_MODE_COSINE
    moved = means.copy()
    for j, mean in enumerate(means):
        around = (np.flatnonzero(label == j), np.flatnonzero((label >= 0) & same_mode[j][label]))
        lines = [downhill(u[rows], f[rows], np.zeros(0, dtype=np.intp)) for rows in around]
        line = max(filter(None, lines), key=lambda found: found.cosine2, default=None)
        if line is not None and line.cosine2 > ALIGNED_COSINE2:
            moved[j] = max(float(mean @ line.vector), 0.0) * line.vector
    if np.array_equal(moved, means):
        return part
    basis = np.linalg.qr(moved.T)[0]
    factors = np.broadcast_to(np.eye(basis.shape[1]), (means.shape[0], basis.shape[1], basis.shape[1])).copy()
    return Part(part.weight, basis, part.shares, moved @ basis, factors, 1.0)


def _widened(covariance: Array) -> Array:
    values, vectors = np.linalg.eigh(covariance)
    values = np.where(values < 1.0, np.minimum(WIDENING * values, 1.0), values)
    widened: Array = (vectors * values) @ vectors.T
    return widened


def _k_means(y: Array, w: Array, k: int, source: np.random.Generator) -> Array:
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
            mine = np.eye(k)[_distances(y, centres).argmin(axis=1)] * w[:, None]
            total = mine.sum(axis=0)
            moved = (mine.T @ y) / np.maximum(total, 1e-300)[:, None]
            moved = np.where(total[:, None] > 0, moved, centres)
            if np.array_equal(moved, centres):
                break
            centres = moved
        distances = _distances(y, centres)
        inertia = float(w @ distances.min(axis=1))
        if inertia < best_inertia:
            best, best_inertia = np.eye(k)[distances.argmin(axis=1)], inertia
    return best


def _distances(y: Array, centres: Array) -> Array:
    squares = np.sum(y * y, axis=1)[:, None] - 2.0 * y @ centres.T + np.sum(centres * centres, axis=1)
    distances: Array = np.maximum(squares, 0.0)
    return distances


def _too_many(form: str, k: int, r: int, ess: float) -> bool:
    """Full covariances need samples enough for them; the other forms are what is left."""
    return form == "full" and r > 1 and _parameters(form, k, r) > ess


def _covariances(form: str, raw: Array, counts: Array, means: Array) -> Array:
    """Of k components with sample covariances `raw` (k, r, r) from samples worth `counts` (k,), shrunk towards I."""
    r = means.shape[1]
    identity = np.eye(r)
    n = counts[:, None, None]
    shrunk: Array
    if form == "spiked":  # as the base's but for the direction of the mean, where an event cuts
        length2 = np.maximum(np.sum(means * means, axis=1), 1e-300)
        spread = np.einsum("ki,kij,kj->k", means, raw, means) / length2
        excess = (counts * spread + 2.0) / (counts + 2.0) - 1.0
        shrunk = identity + (excess / length2)[:, None, None] * means[:, :, None] * means[:, None, :]
    elif form == "diagonal":
        shrunk = (n * raw * identity + 2.0 * identity) / (n + 2.0)
    else:
        shrunk = (n * raw + (r + 1.0) * identity) / (n + r + 1.0)
    return shrunk


def _em(
    y: Array, w: Array, responsibility: Array, ess: float, form: str
) -> tuple[float, Array, Array, Array]:
    """BIC (higher is better), shares (k,), means (k, r) and covariances (k, r, r) of the mixture that EM ends in.

    y: (n, r), samples
    w: (n,), their weights, which sum to one
    responsibility: (n, k), to begin with
    ess: effective number of samples
    form: of the covariances, one of FORMS
    """
    r, k = y.shape[1], responsibility.shape[1]
    previous = -math.inf
    columns = np.ascontiguousarray(y.T)
    share_of = np.ascontiguousarray(responsibility.T)
    for _ in range(_ITERATIONS):
        mass = share_of * w
        total = mass.sum(axis=1)
        shares = np.maximum(total, 1e-10) / np.maximum(total, 1e-10).sum()
        own = mass / np.maximum(total, 1e-300)[:, None]
        counts = total**2 / np.maximum(np.einsum("kn,kn->k", mass, mass), 1e-300)
        means = own @ y
        # Around each mean, not second moments less its square: both may be large beside the variance.
        raw = np.empty((k, r, r))
        for j in range(k):
            centred = columns - means[j][:, None]
            raw[j] = (centred * own[j]) @ centred.T
        covariances = _covariances(form, raw, counts, means)
        factors = np.linalg.cholesky(covariances)
        inverses = np.linalg.inv(factors)
        logs = np.empty((k, y.shape[0]))
        for j in range(k):
            whitened = inverses[j] @ columns - (inverses[j] @ means[j])[:, None]
            np.einsum("in,in->n", whitened, whitened, out=logs[j])
        logs *= -0.5
        logs += (np.log(shares) - np.log(np.diagonal(factors, axis1=1, axis2=2)).sum(axis=1))[:, None]
        top = logs.max(axis=0)
        np.exp(logs - top, out=logs)
        density = logs.sum(axis=0)
        likelihood = float(w @ (np.log(density) + top))
        if k == 1 or likelihood - previous < max(1e-4, LEAST_GAIN / ess):
            break
        previous = likelihood
        share_of = logs / density
    penalty = 0.5 * _parameters(form, k, r) * math.log(max(ess, 2.0))
    return ess * likelihood - penalty, shares, means, covariances


def _parameters(form: str, k: int, r: int) -> int:
    spread = {"full": r * (r + 1) // 2, "diagonal": r, "spiked": 1}[form]
    return k * (r + spread) + k - 1
