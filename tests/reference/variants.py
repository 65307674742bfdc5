"""More problems of the same kinds, kept apart from those that the methods were tuned on: exact probabilities again.

Everything is built from functions of independent standard normals u_i = Phi^{-1}(F_i(x_i)), so that p is a formula.
"""

from collections.abc import Sequence

import numpy as np
from scipy.special import gammaincc, gammaincinv, ndtr

import ce
from ce.standard import to_standard
from tests.reference.problems import Problem, four_branch


def normal(d: int) -> ce.Product:
    return ce.Product([ce.Normal(np.zeros(d), np.eye(d))])


def mixed(copies: int = 1) -> ce.Product:
    """Every family there is, and a correlated normal."""
    cov = np.array([[1.0, 0.6, 0.2], [0.6, 2.0, -0.5], [0.2, -0.5, 1.5]])
    return ce.Product(
        [
            ce.Beta(2.0, 2.0, -1.0, 1.0),
            ce.Normal([1.0, 0.0, -2.0], cov),
            ce.LogNormal(0.2, 0.5),
            ce.Gumbel(1.0, 2.0),
            ce.Weibull(1.5, 2.0),
            ce.Exponential(2.0),
            ce.Uniform(-1.0, 3.0),
            ce.TruncatedNormal(0.0, 1.0, -1.0, 4.0),
        ]
        * copies
    )


def series(
    base: ce.Product, betas: Sequence[float], name: str, directions: np.ndarray | None = None
) -> Problem:
    """min over j of beta_j - a_j . u <= 0 for orthonormal a_j: p = 1 - prod Phi(beta_j)."""
    d, m = base.dim, len(betas)
    if directions is None:
        source = np.random.default_rng(m * 1000 + d)
        directions = np.linalg.qr(source.standard_normal((d, m)))[0].T
    a, b = directions, np.asarray(betas, dtype=np.float64)
    p = float(-np.expm1(np.sum(np.log1p(-ndtr(-b)))))
    return Problem(f"series {name}", base, lambda x: np.min(b - to_standard(base, x) @ a.T, axis=1), 0.0, p)


def parallel(base: ce.Product, betas: Sequence[float], name: str) -> Problem:
    """max over j of beta_j - a_j . u <= 0 for orthonormal a_j: p = prod Phi(-beta_j)."""
    d, m = base.dim, len(betas)
    source = np.random.default_rng(m * 1000 + d)
    a = np.linalg.qr(source.standard_normal((d, m)))[0].T
    b = np.asarray(betas, dtype=np.float64)
    p = float(np.prod(ndtr(-b)))
    return Problem(f"parallel {name}", base, lambda x: np.max(b - to_standard(base, x) @ a.T, axis=1), 0.0, p)


def two_sided(d: int, beta: float) -> Problem:
    return Problem(
        f"two-sided d={d} beta={beta}",
        normal(d),
        lambda x: beta - np.abs(x.sum(axis=1)) / np.sqrt(d),
        0.0,
        float(2 * ndtr(-beta)),
    )


def linear(d: int, beta: float) -> Problem:
    return Problem(
        f"linear d={d} beta={beta}",
        normal(d),
        lambda x: beta - x.sum(axis=1) / np.sqrt(d),
        0.0,
        float(ndtr(-beta)),
    )


def sparse(d: int, beta: float) -> Problem:
    """One coordinate of many matters."""
    return Problem(
        f"sparse d={d} beta={beta}", normal(d), lambda x: beta - x[:, d // 3], 0.0, float(ndtr(-beta))
    )


def autoregressive(d: int, beta: float, r: float = 0.8) -> Problem:
    cov = r ** np.abs(np.subtract.outer(np.arange(d), np.arange(d)))
    sd = float(np.sqrt(cov.sum()))
    base = ce.Product([ce.Normal(np.zeros(d), cov)])
    return Problem(
        f"AR d={d} beta={beta}", base, lambda x: beta - x.sum(axis=1) / sd, 0.0, float(ndtr(-beta))
    )


def misleading() -> Problem:
    """Piecewise linear: f falls faster at first towards the direction of the lesser mode (Breitung 2019)."""

    def f(x: np.ndarray) -> np.ndarray:
        a = np.where(x[:, 0] > 3.5, 4.0 - x[:, 0], 0.85 - 0.1 * x[:, 0])
        b = np.where(x[:, 1] > 2.0, 0.5 - 0.1 * x[:, 1], 2.3 - x[:, 1])
        return np.minimum(a, b)

    return Problem("misleading", normal(2), f, 0.0, float(ndtr(-4) + ndtr(-5) - ndtr(-4) * ndtr(-5)))


def narrow(d: int = 5) -> Problem:
    """A half-space, and a thin slab that is as probable and shows itself only near it."""

    def f(x: np.ndarray) -> np.ndarray:
        slab = np.maximum(3.0 - x[:, 1], 10.0 * (np.abs(x[:, 2] - 1.0) - 0.05))
        return np.minimum(3.8 - x[:, 0], slab)

    one = ndtr(-3.8)
    other = ndtr(-3.0) * (ndtr(1.05) - ndtr(0.95))
    return Problem(f"narrow slab d={d}", normal(d), f, 0.0, float(one + other - one * other))


def steps(d: int, beta: float, height: float = 0.5) -> Problem:
    """f takes few values: ties everywhere."""
    return Problem(
        f"steps d={d} beta={beta}",
        normal(d),
        lambda x: np.ceil((beta - x.sum(axis=1) / np.sqrt(d)) / height) * height,
        0.0,
        float(ndtr(-beta)),
    )


def indicator(beta: float) -> Problem:
    """f says only whether the event happened."""
    return Problem(
        f"indicator beta={beta}",
        normal(3),
        lambda x: np.where(x.sum(axis=1) / np.sqrt(3) >= beta, 0.0, 1.0),
        0.0,
        float(ndtr(-beta)),
    )


def mostly_infinite(d: int, beta: float, from_: float = 1.5) -> Problem:
    """f = +inf but for a corner, as a time to collision is."""

    def f(x: np.ndarray) -> np.ndarray:
        s = x.sum(axis=1) / np.sqrt(d)
        return np.where(s > from_, beta - s, np.inf)

    return Problem(f"mostly inf d={d} beta={beta}", normal(d), f, 0.0, float(ndtr(-beta)))


def noisy(d: int, beta: float, sigma: float) -> Problem:
    """f has randomness of its own, which no proposal reaches."""
    source = np.random.default_rng(12345)

    def f(x: np.ndarray) -> np.ndarray:
        return beta - x.sum(axis=1) / np.sqrt(d) - sigma * source.standard_normal(x.shape[0])

    return Problem(
        f"noisy d={d} beta={beta} sigma={sigma}", normal(d), f, 0.0, float(ndtr(-beta / np.hypot(1, sigma)))
    )


def betas(d: int, q: float) -> Problem:
    """Beta(0.5, 0.5), all above 1 - q."""
    base = ce.Product([ce.Beta(0.5, 0.5) for _ in range(d)])
    one = 2.0 / np.pi * np.arcsin(np.sqrt(q))
    return Problem(f"{d} Beta(.5,.5) above 1-{q}", base, lambda x: -x.min(axis=1), q - 1.0, float(one**d))


def shell(d: int, p_scale: float) -> Problem:
    t = d + p_scale * np.sqrt(2.0 * d)
    return Problem(
        f"|u|^2 > {t:.4g}, d={d}",
        normal(d),
        lambda x: -np.sum(x * x, axis=1),
        -t,
        float(gammaincc(d / 2, t / 2)),
    )


def ring(least: float) -> Problem:
    """A radius in the plane: a mode all round."""
    return Problem(
        f"ring {least}",
        normal(2),
        lambda x: least - np.hypot(x[:, 0], x[:, 1]),
        0.0,
        float(np.exp(-0.5 * least**2)),
    )


def blocks(d: int, beta: float) -> Problem:
    """A few coordinates with two corners that matter much, beside many that matter little together."""

    def f(x: np.ndarray) -> np.ndarray:
        rest = x[:, 4:].sum(axis=1) / np.sqrt(d - 4)
        a, b = (x[:, 0] + x[:, 1]) / np.sqrt(2), (x[:, 2] - x[:, 3]) / np.sqrt(2)
        return beta - 0.9 * np.maximum(a, b) - np.sqrt(1 - 0.81) * rest

    # p = P(max(a, b) > (beta - s r) / 0.9), r normal: by quadrature
    z, w = np.polynomial.hermite_e.hermegauss(200)
    c = (beta - np.sqrt(1 - 0.81) * z) / 0.9
    p = float((w / np.sqrt(2 * np.pi)) @ (2 * ndtr(-c) - ndtr(-c) ** 2))
    return Problem(f"blocks d={d} beta={beta}", normal(d), f, 0.0, p)


def rotated_four_branch(d: int, p: float = 2.22279507e-3) -> Problem:
    """The four branches (k = 7) in a plane of d correlated normals."""
    source = np.random.default_rng(d)
    plane = np.linalg.qr(source.standard_normal((d, d)))[0][:, :2]
    half = source.standard_normal((d, d))
    cov = half @ half.T + np.eye(d)
    white = np.linalg.inv(np.linalg.cholesky(cov)).T @ plane
    mean = np.arange(d, dtype=np.float64)
    known = four_branch(7, p)
    return Problem(
        f"rotated four-branch d={d}",
        ce.Product([ce.Normal(mean, cov)]),
        lambda x: known.f((x - mean) @ white),
        0.0,
        p,
    )


def lognormal_product(d: int, beta: float) -> Problem:
    base = ce.Product([ce.LogNormal(0.0, 0.5) for _ in range(d)])
    return Problem(
        f"product of {d} LogNormals beta={beta}",
        base,
        lambda x: -np.log(x).sum(axis=1),
        -0.5 * beta * np.sqrt(d),
        float(ndtr(-beta)),
    )


def weakest_weibull(d: int, least: float) -> Problem:
    """All of them last long."""
    base = ce.Product([ce.Weibull(1.5, 2.0) for _ in range(d)])
    p = float(np.exp(-d * (least / 2.0) ** 1.5))
    return Problem(f"min of {d} Weibulls > {least}", base, lambda x: -x.min(axis=1), -least, p)


def long_sum(d: int, most: float) -> Problem:
    """A sum of exponentials far above its mean."""
    base = ce.Product([ce.Exponential(1.0) for _ in range(d)])
    return Problem(
        f"sum of {d} Exp(1) > {most:g}", base, lambda x: -x.sum(axis=1), -most, float(gammaincc(d, most))
    )


def ball(d: int, p: float) -> Problem:
    """Close to the centre, where hardly any sample of many dimensions lies."""
    return Problem(
        f"|u|^2 small, d={d}", normal(d), lambda x: np.sum(x * x, axis=1), float(2 * gammaincinv(d / 2, p)), p
    )


def coarse_two_sided(d: int, beta: float) -> Problem:
    """Two modes, and f in steps of a half that gamma is one of."""
    return Problem(
        f"coarse two-sided d={d} beta={beta}",
        normal(d),
        lambda x: -np.floor(2.0 * np.abs(x.sum(axis=1)) / np.sqrt(d)),
        -2.0 * beta,
        float(2 * ndtr(-beta)),
    )


VARIANTS = (
    linear(1, 4.0), linear(10, 0.0), linear(10, 1.0), linear(10, 2.0), linear(20, 6.0), linear(50, 3.0),
    sparse(404, 4.0),
    autoregressive(50, 4.0), autoregressive(300, 3.5),
    two_sided(1, 4.0), two_sided(2, 5.0), two_sided(50, 4.0), two_sided(404, 3.5),
    series(mixed(), [3.5] * 8, "8 modes mixed"), series(mixed(), [3.0, 4.0], "2 modes mixed"),
    series(mixed(3), [4.0] * 4, "4 modes mixed d=30"), series(normal(12), [4.0] * 12, "12 modes d=12"),
    series(normal(100), [3.5, 3.5, 3.7], "3 modes d=100"), series(normal(404), [3.5, 3.6], "2 modes d=404"),
    series(normal(2), [3.5, 4.5], "far 2nd mode d=2"), series(normal(20), [4.0, 4.2, 4.4, 4.6], "4 unequal d=20"),
    parallel(mixed(), [1.5] * 4, "4 of mixed"), parallel(normal(50), [2.0, 2.0, 2.0], "3 d=50"),
    parallel(normal(100), [0.8] * 8, "8 d=100"),
    misleading(), narrow(5), narrow(3), steps(2, 4.0), steps(50, 3.5), indicator(2.0), indicator(3.0),
    mostly_infinite(3, 3.5), mostly_infinite(50, 3.5), mostly_infinite(5, 4.0, 2.5),
    noisy(5, 4.0, 0.5), noisy(5, 4.0, 1.5), noisy(100, 4.0, 1.0), betas(3, 1e-3), betas(8, 0.05),
    shell(50, 5.0), ring(4.0), ring(5.0), blocks(100, 4.0), blocks(404, 3.7),
    rotated_four_branch(2), rotated_four_branch(6), rotated_four_branch(30), lognormal_product(8, 4.0),
    weakest_weibull(4, 3.5), long_sum(10, 32.0), ball(10, 1e-5), coarse_two_sided(6, 4.0), linear(10, 2.3),
)  # fmt: skip
