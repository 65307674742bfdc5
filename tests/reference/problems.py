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


LINEAR_2 = linear(2, 3.5, 2.32629079e-4)
LINEAR_404 = linear(404, 3.5, 2.32629079e-4)
BETAS = all_below(0.2, 1.2166529e-5)
CORRELATED = correlated(4.5, 3.397673e-6)
ALL = (LINEAR_2, LINEAR_404, BETAS, CORRELATED)
