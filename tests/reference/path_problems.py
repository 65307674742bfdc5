"""Random paths whose chance to come to a level is known exactly, by linear algebra, quadrature or a normal tail."""

import functools
import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import log_ndtr, ndtr, ndtri

import ce

Array = NDArray[np.float64]
NODES = 400


@dataclass(frozen=True)
class PathProblem:
    """p = P(the smallest measure along a path <= gamma), exact to at least six digits."""

    name: str
    process: ce.Simulator
    gamma: float
    p: float


def normal_base(d: int) -> ce.Product:
    """X ~ N(0, I_d)."""
    return ce.Product([ce.Normal(np.zeros(d), np.eye(d))])


@dataclass(frozen=True)
class Gaussian:
    """s' = pull s + spread z from s = s0 x, x standard normal, in `steps` steps; hit at s >= level, steps 0
    included."""

    pull: float
    spread: float
    start: float
    steps: int

    def hit(self, level: float) -> Callable[[Array], Array]:
        """h(s), the chance to come to the level within the steps after s < level, by quadrature."""
        sd = math.sqrt(self.spread**2 * self.steps + self.start**2) + self.start
        low = -8.0 * sd
        y, w = np.polynomial.legendre.leggauss(NODES)
        y, w = 0.5 * (level - low) * (y + 1.0) + low, 0.5 * (level - low) * w

        def kernel(s: Array) -> tuple[Array, Array]:
            z = (y[None, :] - self.pull * s[:, None]) / self.spread
            return np.exp(-0.5 * z * z) / math.sqrt(2 * math.pi) / self.spread * w, ndtr(
                (self.pull * s - level) / self.spread
            )

        inner, leaves = kernel(y)
        h = np.zeros(NODES)
        for _ in range(self.steps - 1):
            h = leaves + inner @ h

        def at(s: Array) -> Array:
            onto, out = kernel(s)
            return out + onto @ h

        return at

    def p(self, level: float) -> float:
        """Chance that a path comes to the level."""
        x, w = np.polynomial.legendre.leggauss(NODES)
        top = min(level / self.start, 9.0)
        x, w = 0.5 * (top + 9.0) * (x + 1.0) - 9.0, 0.5 * (top + 9.0) * w
        inside = self.hit(level)(self.start * x) * np.exp(-0.5 * x * x) / math.sqrt(2 * math.pi)
        return float(w @ inside + ndtr(-level / self.start))

    def simulator(self, level: float) -> ce.Simulator:
        """Measure: what is missing to the level."""
        return ce.Simulator(
            base=normal_base(1),
            start=lambda x: self.start * x,
            step=lambda s, z, k: self.pull * s + self.spread * z,
            measure=lambda s: level - s[:, 0],
            horizon=self.steps,
        )


def gaussian(name: str, of: Gaussian, level: float) -> PathProblem:
    """The chance that such a path comes to the level."""
    return PathProblem(name, of.simulator(level), 0.0, of.p(level))


def birth_death(up: float, size: int, steps: int) -> PathProblem:
    """A chain on 0 .. size that begins at 0, 1 or 2 and goes up with chance up / (1 + k / size), down otherwise."""
    rise = up / (1.0 + np.arange(size + 1) / size)
    matrix = np.zeros((size + 1, size + 1))
    for k in range(size):
        matrix[k, k + 1] = rise[k]
        matrix[k, max(k - 1, 0)] += 1.0 - rise[k]
    matrix[size, size] = 1.0
    hit = np.zeros(size + 1)
    hit[size] = 1.0
    for _ in range(steps):
        hit = matrix @ hit

    def step(s: Array, z: Array, k: int) -> Array:
        at = s[:, 0].astype(np.int64)
        risen = ndtr(z[:, 0]) < rise[np.minimum(at, size)]
        there = at >= size
        return np.where(there, at, np.where(risen, at + 1, np.maximum(at - 1, 0))).astype(np.float64)[:, None]

    process = ce.Simulator(
        base=ce.Product([ce.Uniform(0.0, 3.0)]),
        start=np.floor,
        step=step,
        measure=lambda s: size - s[:, 0],
        horizon=steps,
        features=lambda s: s / size,
    )
    return PathProblem(f"birth-death chain of {size}", process, 0.0, float(hit[:3].mean()))


def switching(level: float, steps: int = 100) -> PathProblem:
    """Heston-like: s' = s + v z with a volatility v that moves by chance among five values; hit at s <= -level."""
    vol = np.array([0.05, 0.08, 0.13, 0.2, 0.3])
    chain = np.zeros((5, 5))
    for k in range(5):
        chain[k, max(k - 1, 0)] += 0.06
        chain[k, min(k + 1, 4)] += 0.04
        chain[k, k] += 0.9
    high = 8.0 * vol[-1] * math.sqrt(steps)
    y, w = np.polynomial.legendre.leggauss(1200)
    y, w = 0.5 * (high + level) * (y + 1.0) - level, 0.5 * (high + level) * w
    inner, out = [], []
    at = np.append(y, 0.0)
    for v in vol:
        z = (y[None, :] - at[:, None]) / v
        inner.append(np.exp(-0.5 * z * z) / math.sqrt(2 * math.pi) / v * w)
        out.append(ndtr((-level - at) / v))
    hit = np.zeros((5, at.size))
    for _ in range(steps):
        after = np.array([out[k] + inner[k] @ hit[k, :-1] for k in range(5)])
        hit = chain @ after  # the volatility moves first, then the price
    begin = np.full(5, 0.2)

    def start(x: Array) -> Array:
        return np.column_stack([np.zeros(len(x)), np.minimum(np.floor(5.0 * x[:, 0]), 4.0)])

    def step(s: Array, z: Array, k: int) -> Array:
        u = ndtr(z[:, 1])
        v = np.clip(s[:, 1] + (u > 0.96) - (u < 0.06), 0, 4)
        return np.column_stack([s[:, 0] + vol[v.astype(np.int64)] * z[:, 0], v])

    process = ce.Simulator(
        base=ce.Product([ce.Uniform(0.0, 1.0)]),
        start=start,
        step=step,
        measure=lambda s: level + s[:, 0],
        horizon=steps,
        noise=2,
    )
    return PathProblem(f"switching volatility to {level}", process, 0.0, float(begin @ hit[:, -1]))


def decided_at_once(beta: float, d: int = 5) -> PathProblem:
    """Nothing is left to chance after the start: the path goes straight to beta - sum(x) / sqrt(d)."""

    def step(s: Array, z: Array, k: int) -> Array:
        return np.column_stack([s[:, :d], s[:, d] + 1.0])

    process = ce.Simulator(
        base=normal_base(d),
        start=lambda x: np.column_stack([x, np.zeros(len(x))]),
        step=step,
        measure=lambda s: 2.0 * beta + (s[:, d] / 50.0) * (-beta - s[:, :d].sum(axis=1) / math.sqrt(d)),
        horizon=50,
        features=lambda s: s[:, :d],
    )
    # at the last step 2 beta - beta - sum / sqrt(d) <= 0; on the way it is no smaller
    return PathProblem(f"decided at the start, beta={beta}", process, 0.0, float(ndtr(-beta)))


def decided_at_last(beta: float) -> PathProblem:
    """Everything is left to the last step."""

    def step(s: Array, z: Array, k: int) -> Array:
        return np.where(k == 49, z, s)

    process = ce.Simulator(
        base=normal_base(1),
        start=lambda x: 0.0 * x,
        step=step,
        measure=lambda s: beta - s[:, 0],
        horizon=50,
    )
    return PathProblem(f"decided at the last step, beta={beta}", process, 0.0, float(ndtr(-beta)))


def three_modes(p: float) -> PathProblem:
    """Decided by the start, by a walk in the first third, or by another in the last third, a third of p each."""
    each = -math.expm1(math.log1p(-p) / 3.0)
    first = Gaussian(0.95, 0.2, 0.3, 33)
    last = Gaussian(0.9, 0.3, 0.3, 34)
    levels = np.array([-ndtri(each), _level(first, each), _level(last, each)])

    def step(s: Array, z: Array, k: int) -> Array:
        out = s.copy()
        if k < 33:
            out[:, 1] = 0.95 * s[:, 1] + 0.2 * z[:, 0]
        elif k >= 66:
            out[:, 2] = 0.9 * s[:, 2] + 0.3 * z[:, 1]
        return out

    process = ce.Simulator(
        base=normal_base(3),
        start=lambda x: x * np.array([1.0, 0.3, 0.3]),
        step=step,
        measure=lambda s: (1.0 - s / levels).min(axis=1),
        horizon=100,
        noise=2,
    )
    return PathProblem(f"three modes of unlike times, p={p:g}", process, 0.0, p)


def _level(of: Gaussian, p: float) -> float:
    """The level that such a path comes to with chance p."""
    low, high = 0.1, 10.0
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if of.p(middle) > p else (low, middle)
    return 0.5 * (low + high)


WALK = Gaussian(1.0, 0.1, 0.3, 100)
REVERTING = Gaussian(0.95, 0.3122498999199199, 0.5, 100)  # a stationary standard deviation of 1


@functools.cache
def all_problems() -> tuple[PathProblem, ...]:
    """Every problem; made on demand, as their p take seconds."""
    return (
        gaussian("random walk to 4", WALK, 4.0),
        gaussian("random walk to 5", WALK, 5.0),
        gaussian("Ornstein-Uhlenbeck to 5", REVERTING, 5.0),
        gaussian("Ornstein-Uhlenbeck to 6", REVERTING, 6.0),
        birth_death(0.55, 20, 100),
        switching(9.0),
        decided_at_once(4.0),
        decided_at_last(3.0),
        three_modes(3e-5),
    )


def log_tail(x: Array) -> Array:
    """log Phi(-x), for committors made by hand."""
    return np.asarray(log_ndtr(-x))
