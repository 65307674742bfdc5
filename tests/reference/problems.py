"""Rare-event problems with exactly known probabilities: base distribution, f, gamma, p."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

import ce


@dataclass(frozen=True)
class Problem:
    """p = P0(f(X) <= gamma), exact to all digits given."""

    name: str
    base: ce.Product
    f: Callable[[np.ndarray], np.ndarray]
    gamma: float
    p: float


def linear(d: int, beta: float, p: float) -> Problem:
    """X ~ N(0, I_d); f(x) = beta - sum(x) / sqrt(d); p = Phi(-beta)."""
    base = ce.Product([ce.Normal(np.zeros(d), np.eye(d))])
    return Problem(f"linear d={d} beta={beta}", base, lambda x: beta - x.sum(axis=1) / np.sqrt(d), 0.0, p)


def all_below(q: float, p: float) -> Problem:
    """Five Beta(2, 2), all below q: p = (3 q^2 - 2 q^3)^5."""
    base = ce.Product([ce.Beta(2.0, 2.0) for _ in range(5)])
    return Problem(f"five Beta(2,2) below {q}", base, lambda x: x.max(axis=1), q, p)


def correlated(beta: float, p: float) -> Problem:
    """X ~ N(m, S) in R^3 with correlation beside a Beta that does not matter; f = beta - (a.x - a.m)/sd."""
    mean = np.array([1.0, -2.0, 0.5])
    cov = np.array([[2.0, 0.6, -0.3], [0.6, 1.0, 0.2], [-0.3, 0.2, 0.5]])
    a = np.array([1.0, 1.0, -1.0])
    sd = float(np.sqrt(a @ cov @ a))
    base = ce.Product([ce.Beta(2.0, 3.0, -1.0, 4.0), ce.Normal(mean, cov)])
    return Problem(
        f"correlated beta={beta}", base, lambda x: beta - (x[:, 1:] @ a - float(a @ mean)) / sd, 0.0, p
    )


def four_branch(k: float, p: float) -> Problem:
    """The series system of four branches in N(0, I_2), two of them parabolas."""

    def f(x: np.ndarray) -> np.ndarray:
        a, b = x[:, 0], x[:, 1]
        curve, half = 0.1 * (a - b) ** 2, (a + b) / np.sqrt(2.0)
        return np.minimum.reduce(
            [3.0 + curve - half, 3.0 + curve + half, a - b + k / np.sqrt(2.0), b - a + k / np.sqrt(2.0)]
        )

    return Problem(f"four-branch k={k:g}", _normal(2), f, 0.0, p)


def rp25(p: float) -> Problem:
    """max(x^2 - 8 y + 16, -16 x + y + 32) < 0 in N(0, I_2)."""
    return Problem(
        "RP25",
        _normal(2),
        lambda x: np.maximum(x[:, 0] ** 2 - 8 * x[:, 1] + 16, -16 * x[:, 0] + x[:, 1] + 32),
        0.0,
        p,
    )


def two_corners(least: float, p: float) -> Problem:
    """min(|x|, y) >= least in N(0, I_2): p = 2 Phi(-least)^2."""
    return Problem(
        f"min(|x|, y) >= {least:g}", _normal(2), lambda x: -np.minimum(np.abs(x[:, 0]), x[:, 1]), -least, p
    )


def radius(t: float, p: float, d: int = 404) -> Problem:
    """|x|^2 > t in N(0, I_d)."""
    return Problem(f"|x|^2 > {t:g}, d={d}", _normal(d), lambda x: -np.sum(x * x, axis=1), -t, p)


def exponentials(d: int, c: float, p: float) -> Problem:
    """The sum of d unit exponentials below c (d = 404: the problem of Fujita and Rackwitz)."""
    base = ce.Product([ce.Exponential() for _ in range(d)])
    return Problem(f"sum of {d} Exp(1) < {c:g}", base, lambda x: x.sum(axis=1), c, p)


def _normal(d: int) -> ce.Product:
    return ce.Product([ce.Normal(np.zeros(d), np.eye(d))])


LINEAR_2 = linear(2, 3.5, 2.32629079e-4)
LINEAR_404 = linear(404, 3.5, 2.32629079e-4)
BETAS = all_below(0.2, 1.2166529e-5)
CORRELATED = correlated(4.5, 3.397673e-6)
ALL = (
    LINEAR_2,
    linear(100, 3.5, 2.32629079e-4),
    linear(100, 4.5, 3.397673e-6),
    LINEAR_404,
    linear(404, 4.5, 3.397673e-6),
    linear(404, 5.0, 2.86651572e-7),
    CORRELATED,
    four_branch(7, 2.22279507e-3),
    four_branch(6, 4.45733149e-3),
    rp25(4.14856629e-5),
    two_corners(2, 1.03513701e-3),
    two_corners(3, 3.64444939e-6),
    radius(530, 2.41347613e-5),
    radius(560, 4.10219813e-7),
    BETAS,
    all_below(0.1, 1.7210368e-8),
    exponentials(20, 8.951, 9.90603073e-4),
    exponentials(404, 333.488553829, 1e-4),
)
