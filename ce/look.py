"""A look of its own for parts of the event that the search has not touched.

The search comes from the base and follows the lowest values of f; a part of the event that lies off that way is never
sampled, and no weight shows it. The look comes from the other side: rows drawn hot, N(0, s^2 I) with s up to HOTTEST,
reach far half-spaces and corners with similar probability whatever lies on the way. Those that are events seed chains
of preconditioned Crank-Nicolson moves (Cotter, Roberts, Stuart and White, Statistical Science 28, 2013) that stay
within the event and have the base as their stationary law, so that they cool down to where that part of the event is
probable. What the search's proposals do not cover there is fitted and added to them; its share of p is left to the
weights of the rollouts that follow.
"""

import math

import msgspec
import numpy as np
from numpy.typing import NDArray

from ce.streams import generator

Array = NDArray[np.float64]

COOLEST, HOTTEST = 1.25, 4.0  # scales of the hot rows
MOVES = 20  # of each chain
KEPT_MOVES = 10  # the last ones, whose states are looked at
LEAST_CHAINS = 20
MOST_CHAINS = 400
MOST_HOT = 4000
AIM = 0.35  # acceptance
LEAST_EVENTS = 8  # hot rows that must be events before the search itself has come to gamma
WORTH = 1.5  # independent states that a chain is worth
FAR = 20.0  # times the heaviest usual weight of the event, from which a state counts as not covered
USUAL = 0.95  # of the event's mass lies at weights up to the heaviest usual one
_HOT_KIND, _MOVE_KIND = 0x686F7400, 0x636F6F6C


class Look(msgspec.Struct, frozen=True, eq=False):
    """step: 0 before the hot rows, then 1 + moves made; bound: gamma once the chains have begun or where the search
    has reached it, +inf before; u (m, d), f (m,), noise (m,): their states; size: of the moves; seen (h, d): states
    of the last KEPT_MOVES moves."""

    step: int
    bound: float
    u: Array
    f: Array
    noise: NDArray[np.uint64]
    size: float
    seen: Array

    @property
    def over(self) -> bool:
        return self.step > 0 and (self.f.size == 0 or self.step > MOVES)


def begun(dim: int, bound: float) -> Look:
    """bound: gamma where the search has reached it, +inf where it has not."""
    return Look(
        0, bound, np.zeros((0, dim)), np.zeros(0), np.zeros(0, dtype=np.uint64), 0.5, np.zeros((0, dim))
    )


def sizes(budget: int) -> tuple[int, int]:
    """Hot rows and chains for what the look may cost in all; (0, 0) where that is too little."""
    chains = min(int(0.6 * budget) // MOVES, MOST_CHAINS)
    return (min(int(0.4 * budget), MOST_HOT), chains) if chains >= LEAST_CHAINS else (0, 0)


def batch(look: Look, hot: int, seed: int, iteration: int) -> tuple[Array, NDArray[np.uint64]]:
    """u (n, d) and noise (n,) of the next batch; a function of its arguments alone."""
    d = look.u.shape[1]
    if look.step == 0:
        source = generator(seed, _HOT_KIND, "train", iteration, 0)
        scale = np.geomspace(COOLEST, HOTTEST, hot)[:, None]
        z = source.standard_normal((hot, d))
        # Every other row is hot in some coordinates only: f may know nothing of points hot in all of many.
        share = source.random((hot, 1)) ** 2
        some = (source.random((hot, d)) < share) | (np.arange(hot)[:, None] % 2 == 0)
        return np.where(some, scale, 1.0) * z, source.bit_generator.random_raw(hot)
    source = generator(seed, _MOVE_KIND, "train", iteration, 0)
    n = look.f.size
    z = source.standard_normal((n, d))
    fresh = source.random(n) < 0.5
    noise = np.where(fresh, source.bit_generator.random_raw(n), look.noise)
    return math.sqrt(1.0 - look.size**2) * look.u + look.size * z, noise


def answered(
    look: Look,
    u: Array,
    noise: NDArray[np.uint64],
    f: Array,
    gamma: float,
    chains: int,
    seed: int,
    iteration: int,
) -> Look:
    """The look after the batch (u, noise) was answered with f."""
    if look.step == 0:
        below = np.flatnonzero(f <= gamma)
        if below.size < (LEAST_EVENTS if look.bound > gamma else 1):
            return msgspec.structs.replace(look, step=1)
        rows = below[_spread(u[below], chains, generator(seed, _HOT_KIND, "train", iteration, 1))]
        rows = np.resize(rows, chains)
        return msgspec.structs.replace(look, step=1, bound=gamma, u=u[rows], f=f[rows], noise=noise[rows])
    taken = f <= look.bound
    size = look.size * math.exp((2.0 / math.sqrt(look.step)) * (float(np.mean(taken)) - AIM))
    u = np.where(taken[:, None], u, look.u)
    seen = np.concatenate([look.seen, u]) if look.step > MOVES - KEPT_MOVES else look.seen
    return msgspec.structs.replace(
        look,
        step=look.step + 1,
        u=u,
        f=np.where(taken, f, look.f),
        noise=np.where(taken, noise, look.noise),
        size=min(max(size, 0.02), 0.9),
        seen=seen,
    )


def _spread(u: Array, count: int, source: np.random.Generator) -> NDArray[np.intp]:
    """Rows of u that point in different directions: k-means++ seeding on the unit sphere."""
    n = u.shape[0]
    if n <= count:
        return np.arange(n)
    unit = u / np.maximum(np.sqrt(np.sum(u * u, axis=1, keepdims=True)), 1e-300)
    chosen = [int(source.integers(n))]
    distance = np.full(n, np.inf)
    for _ in range(count - 1):
        distance = np.minimum(distance, np.maximum(1.0 - unit @ unit[chosen[-1]], 0.0))
        distance[chosen] = 0.0
        mass = np.cumsum(distance)
        if not mass[-1] > 0:
            break
        chosen.append(int(np.searchsorted(mass, source.random() * mass[-1]).clip(0, n - 1)))
    return np.unique(np.array(chosen, dtype=np.intp))


def uncovered(log_w: Array, event_log_w: Array) -> NDArray[np.bool_]:
    """Which states (log weights base / proposal, (h,)) weigh far more than the event usually does where it was sampled:
    there hardly a rollout of the proposal would come."""
    if event_log_w.size == 0:
        return np.ones(log_w.size, dtype=bool)
    order = np.argsort(event_log_w)
    mass = np.cumsum(np.exp(event_log_w[order] - event_log_w.max()))
    usual = event_log_w[order][int(np.searchsorted(mass, USUAL * mass[-1]).clip(0, order.size - 1))]
    return log_w > usual + math.log(FAR)
