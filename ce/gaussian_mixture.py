"""Mixtures in standard-normal space: the proposals of the adaptive methods.

q(u) = e phi_d(u) + sum over parts s of c_s sum_j pi_sj N(V_s^T u; m_sj, C_sj) N(V_s_perp^T u; 0, t_s^2 I)

with phi_d the base itself. Its share e > 0 bounds every weight phi / q by 1 / e (defensive mixture: Hesterberg,
Technometrics 37, 1995; Owen and Zhou, JASA 95, 2000). V_s (d, r) spans the few directions in which part s
differs from the base; everything orthogonal to them stays as it is but for one common scale t_s.
"""

import math
from collections.abc import Sequence

import msgspec
import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_triangular

from ce.streams import CHUNK, generator

Array = NDArray[np.float64]
_U_KIND = 0x6D697874


class Part(msgspec.Struct, frozen=True, eq=False):
    """A Gaussian mixture on a subspace.

    weight: c_s, in the whole mixture
    basis: V (d, r), orthonormal
    shares: pi (k,), of the components, summing to one
    means: (k, r)
    factors: (k, r, r), lower Cholesky factors of the covariances
    scale: t, standard deviation of what is orthogonal to the subspace
    """

    weight: float
    basis: Array
    shares: Array
    means: Array
    factors: Array
    scale: float


class Mixture(msgspec.Struct, frozen=True, eq=False):
    """The base and parts beside it.

    base_share: e, of the base; with the parts' weights it sums to one
    parts: beside the base
    """

    base_share: float
    parts: tuple[Part, ...]


def only_base() -> Mixture:
    """The base itself."""
    return Mixture(1.0, ())


def draw_standard(
    mixture: Mixture, dim: int, seed: int, phase: str, iteration: int, start: int, stop: int
) -> Array:
    """Rows [start, stop) of the stream, u (n, d); whole chunks are drawn, as in `ce.streams.draw`."""
    u = np.empty((stop - start, dim))
    for chunk in range(start // CHUNK, -(-stop // CHUNK)):
        first = chunk * CHUNK
        rows = slice(max(start - first, 0), min(stop - first, CHUNK))
        source = generator(seed, _U_KIND, phase, iteration, chunk)
        z = source.standard_normal((CHUNK, dim))
        u[first + rows.start - start : first + rows.stop - start] = _shifted(
            mixture, z, source.random(CHUNK)
        )[rows]
    return u


def _shifted(mixture: Mixture, z: Array, pick: Array) -> Array:
    """Standard normals z (n, d) moved to the mixture, each row to the component that its uniform pick (n,) chooses."""
    upto = mixture.base_share
    for part in mixture.parts:
        for share, mean, factor in zip(part.shares, part.means, part.factors, strict=True):
            rows = np.flatnonzero((pick >= upto) & (pick < upto + part.weight * share))
            upto += part.weight * share
            inner = z[rows] @ part.basis
            z[rows] = part.scale * (z[rows] - inner @ part.basis.T) + (mean + inner @ factor.T) @ part.basis.T
    return z


def log_ratio(mixture: Mixture, u: Array) -> Array:
    """log q(u) - log phi(u), (n,)."""
    terms = np.stack(_log_terms(mixture, u))
    top = terms.max(axis=0)
    terms -= top
    ratio: Array = np.log(np.exp(terms, out=terms).sum(axis=0)) + top
    return ratio


def mean_log_ratio(mixtures: Sequence[Mixture], u: Array) -> Array:
    """log of the mean over the mixtures of q / phi, (n,), of u (n, d).

    Its negative is the log weight by the balance heuristic (Veach and Guibas, SIGGRAPH 1995; Owen and Zhou, JASA 95,
    2000).
    """
    total = np.zeros(u.shape[0])
    for count, mixture in enumerate(mixtures):
        ratio = log_ratio(mixture, u)
        total = ratio if count == 0 else np.logaddexp(total, ratio)
    return total - math.log(len(mixtures))


def component_of(mixture: Mixture, u: Array) -> NDArray[np.intp]:
    """Which component of the mixture, the base the first of them, each u (n, d) most probably came from, (n,)."""
    component: NDArray[np.intp] = np.argmax(np.stack(_log_terms(mixture, u)), axis=0)
    return component


def _log_terms(mixture: Mixture, u: Array) -> list[Array]:
    """log of each component's share of q(u) / phi(u), the base's first, each (n,)."""
    n = u.shape[0]
    terms = [np.full(n, math.log(mixture.base_share) if mixture.base_share > 0 else -math.inf)]
    if not mixture.parts:
        return terms
    norm2 = np.sum(u * u, axis=1)
    for part in mixture.parts:
        inner = u @ part.basis
        inner2 = np.sum(inner * inner, axis=1)
        rest = u.shape[1] - part.basis.shape[1]
        outside = -rest * math.log(part.scale) - 0.5 * (part.scale**-2 - 1.0) * (norm2 - inner2)
        with np.errstate(divide="ignore"):
            log_shares = np.log(part.weight * part.shares)
        for log_share, mean, factor in zip(log_shares, part.means, part.factors, strict=True):
            terms.append(log_share + outside + log_normal(inner, mean, factor) + 0.5 * inner2)
    return terms


def log_normal(y: Array, mean: Array, factor: Array) -> Array:
    """log N(y; mean, factor factor^T) + (r/2) log(2 pi), (n,), of y (n, r)."""
    whitened = solve_triangular(factor, (y - mean).T, lower=True, check_finite=False)
    log_p: Array = -0.5 * np.einsum("in,in->n", whitened, whitened)
    return log_p - float(np.sum(np.log(np.diagonal(factor))))
