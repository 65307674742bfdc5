"""An experiment kept beside its record (decision 61): improved cross-entropy with von Mises-Fisher-Nakagami mixtures.

Papaioannou, Geyer and Straub, Reliability Engineering & System Safety 191, 2019; Wang and Song, Structural Safety 59,
2016. Run from the repository root: python -m tests.bench.ce_vmfn [SEEDS [WORD ...]]. Minutes. The same budget for
both: the experiment's levels have a tenth of it each; its estimate comes from its last proposal with what is left.
"""

import math
import sys
import time

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq
from scipy.special import gammaln, ive, log_ndtr, ndtr

import ce
from ce.standard import from_standard
from tests.reference.problems import ALL, Problem

Array = NDArray[np.float64]
TARGET_CV = 1.5
BUDGET = 20_000


def log_bessel(order: float, x: Array) -> Array:
    """log I_order(x): scipy's, or the uniform expansion for large orders (Abramowitz and Stegun 9.7.7)."""
    if order < 40:
        return np.log(ive(order, x)) + x
    z = x / order
    root = np.sqrt(1.0 + z * z)
    eta = root + np.log(z / (1.0 + root))
    t = 1.0 / root
    return (
        order * eta
        - 0.5 * np.log(2 * np.pi * order)
        - 0.5 * np.log(root)
        + np.log1p((3 * t - 5 * t**3) / 24 / order)
    )


def log_q_over_phi(u: Array, shares: Array, mu: Array, kappa: Array, m: Array, omega: Array) -> Array:
    """log q - log phi in polar coordinates, (n,)."""
    d = u.shape[1]
    r = np.sqrt(np.sum(u * u, axis=1))
    cosine = (u / r[:, None]) @ mu.T
    log_area = math.log(2) + d / 2 * math.log(math.pi) - gammaln(d / 2)
    log_chi = (d - 1) * np.log(r) - r * r / 2 - (d / 2 - 1) * math.log(2) - gammaln(d / 2)
    order = d / 2 - 1
    log_c = order * np.log(kappa) - d / 2 * math.log(2 * math.pi) - log_bessel(order, kappa)
    nakagami = (
        math.log(2)
        + m * np.log(m / omega)
        - gammaln(m)
        + (2 * m - 1) * np.log(r)[:, None]
        - (r * r)[:, None] * m / omega
    )
    terms = np.log(shares) + log_c + kappa * cosine + log_area + nakagami - log_chi[:, None]
    return np.logaddexp.reduce(terms, axis=1)


def draw(
    source: np.random.Generator, n: int, shares: Array, mu: Array, kappa: Array, m: Array, omega: Array
) -> Array:
    """Wood's sampler (Communications in Statistics 23, 1994) for the directions."""
    k, d = mu.shape
    label = source.choice(k, size=n, p=shares)
    out = np.empty((n, d))
    for j in range(k):
        rows = np.flatnonzero(label == j)
        b = (d - 1) / (2 * kappa[j] + math.sqrt(4 * kappa[j] ** 2 + (d - 1) ** 2))
        x0 = (1 - b) / (1 + b)
        c = kappa[j] * x0 + (d - 1) * math.log(1 - x0 * x0)
        cosine = np.full(rows.size, np.nan)
        while (open_ := np.flatnonzero(np.isnan(cosine))).size:
            z = source.beta((d - 1) / 2, (d - 1) / 2, size=open_.size)
            w = (1 - (1 + b) * z) / (1 - (1 - b) * z)
            good = kappa[j] * w + (d - 1) * np.log(1 - x0 * w) - c >= np.log(source.random(open_.size))
            cosine[open_[good]] = w[good]
        v = source.standard_normal((rows.size, d))
        v -= (v @ mu[j])[:, None] * mu[j]
        v /= np.sqrt(np.sum(v * v, axis=1))[:, None]
        direction = cosine[:, None] * mu[j] + np.sqrt(np.maximum(1 - cosine**2, 0))[:, None] * v
        radius = np.sqrt(source.gamma(m[j], omega[j] / m[j], size=rows.size))
        out[rows] = radius[:, None] * direction
    return out


def fitted(u: Array, w: Array, k: int, source: np.random.Generator) -> tuple[Array, ...]:
    """Weighted EM from random responsibilities around k samples."""
    n, d = u.shape
    r2 = np.sum(u * u, axis=1)
    a = u / np.sqrt(r2)[:, None]
    centres = a[source.choice(n, size=k, replace=False, p=w)]
    resp = np.eye(k)[np.argmax(a @ centres.T, axis=1)]
    for _ in range(15):
        mass = w[:, None] * resp
        shares = np.maximum(mass.sum(axis=0), 1e-8)
        shares = shares / shares.sum()
        mean = (mass.T @ a) / np.maximum(mass.sum(axis=0), 1e-300)[:, None]
        length = np.clip(np.sqrt(np.sum(mean * mean, axis=1)), 1e-4, 0.999)
        mu = mean / np.maximum(np.sqrt(np.sum(mean * mean, axis=1)), 1e-300)[:, None]
        kappa = (length * d - length**3) / (1 - length**2)
        omega = (mass.T @ r2) / np.maximum(mass.sum(axis=0), 1e-300)
        fourth = (mass.T @ (r2 * r2)) / np.maximum(mass.sum(axis=0), 1e-300)
        m = np.clip(omega**2 / np.maximum(fourth - omega**2, 1e-9), 0.5, 1e5)
        parameters = (shares, mu, kappa, m, omega)
        if k == 1:
            break
        each = np.stack(
            [log_q_over_phi(u, np.ones(1), mu[[j]], kappa[[j]], m[[j]], omega[[j]]) for j in range(k)], axis=1
        ) + np.log(shares)
        resp = np.exp(each - np.logaddexp.reduce(each, axis=1)[:, None])
    return parameters


def improved_ce(problem: Problem, k: int, seed: int) -> tuple[float, float, int]:
    """p, its standard error, calls of f."""
    source = np.random.default_rng(seed)
    d, n = problem.base.dim, BUDGET // 10
    sigma, calls, q = math.inf, 0, None
    while True:
        u = source.standard_normal((n, d)) if q is None else draw(source, n, *q)
        log_ratio = np.zeros(n) if q is None else log_q_over_phi(u, *q)
        g = problem.f(from_standard(problem.base, u)) - problem.gamma
        calls += n
        event = g <= 0

        def weights(s: float, g: Array = g, log_ratio: Array = log_ratio) -> Array:
            logs = log_ndtr(-g / s) - log_ratio  # relative to the largest: as s falls all of them underflow
            return np.exp(logs - logs.max())

        def excess(log_s: float) -> float:
            w = weights(math.exp(log_s))
            return w.std() / w.mean() - TARGET_CV

        smooth = event / np.maximum(ndtr(-g / sigma), 1e-300) if sigma < math.inf else event * 2.0
        done = event.any() and smooth.std() / smooth.mean() <= TARGET_CV
        if done or calls > 0.7 * BUDGET or (q is not None and not np.isfinite(log_ratio).all()):
            break
        top = math.log(min(sigma, 20 * np.std(g)))
        low = top - 12
        log_s = low if excess(low) < 0 else (top if excess(top) > 0 else brentq(excess, low, top, xtol=1e-2))
        sigma = math.exp(log_s)
        w = weights(sigma)
        q = fitted(u, w / w.sum(), k, source)
    assert q is not None
    left = BUDGET - calls
    u = draw(source, left, *q)
    terms = np.exp(-log_q_over_phi(u, *q)) * (problem.f(from_standard(problem.base, u)) <= problem.gamma)
    return float(terms.mean()), float(terms.std() / math.sqrt(left)), BUDGET


def main() -> None:
    seeds = int(sys.argv[1]) if len(sys.argv) > 1 else 20
    names = (
        "linear d=2 ",
        "RP25",
        "four-branch k=7",
        "min(|x|, y) >= 3",
        "linear d=100 beta=4.5",
        "d=404 beta=4.5",
        "> 530",
    )
    names = tuple(sys.argv[2:]) or names
    for problem in ALL:
        if not any(name in problem.name for name in names):
            continue
        for label, run in (
            ("vMFN 1", lambda s, q=problem: improved_ce(q, 1, s)[:2]),
            ("vMFN 4", lambda s, q=problem: improved_ce(q, 4, s)[:2]),
            ("mixture", lambda s, q=problem: _mixture(q, s)),
        ):
            began = time.process_time()
            runs = np.array([run(s) for s in range(seeds)])
            p = runs[:, 0]
            covered = np.mean(np.abs(p - problem.p) <= 1.96 * runs[:, 1])
            efficiency = problem.p * (1 - problem.p) / BUDGET / float(np.mean((p - problem.p) ** 2))
            print(
                f"| {problem.name} | {label} | {p.mean() / problem.p - 1:+.1%} | {covered:.0%} | {efficiency:.2g} | "
                f"{(time.process_time() - began) / seeds:.2f} |",
                flush=True,
            )


def _mixture(problem: Problem, seed: int) -> tuple[float, float]:
    est = ce.estimate(problem.f, problem.base, problem.gamma, "mixture", budget=BUDGET, seed=seed)
    return est.p, est.std_error


if __name__ == "__main__":
    main()
