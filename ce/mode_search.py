"""A search of its own for modes: parts of the event that the proposals have not touched.

The search for a proposal comes from the base and follows the lowest values of f; a part of the event that lies off
that way is never sampled, and no weight shows it. The mode search comes from the other side: rows drawn hot,
N(0, s^2 I) with s up to HOTTEST, reach far half-spaces and corners with similar probability whatever lies on the way.
Those that are events seed chains of preconditioned Crank-Nicolson moves (`ce.chains`) that stay within the event and
have the base as their stationary law, so that they cool down to where that part of the event is probable. What the
proposals do not cover there is fitted and added to them; its share of p is left to the weights of the rollouts that
follow.
"""

import math

import msgspec
import numpy as np
from numpy.typing import NDArray

from ce.chains import Chains
from ce.streams import generator

Array = NDArray[np.float64]

# Scales of the hot rows.
COOLEST, HOTTEST = 1.25, 4.0
# Moves of each chain, and the last of them, whose states are kept.
MOVES, KEPT_MOVES = 20, 10
LEAST_CHAINS, MOST_CHAINS = 20, 400
MOST_HOT = 4000
# Share of the cost that the hot rows may have, and that the chains may have.
HOT_SHARE, CHAINS_SHARE = 0.4, 0.6
# Acceptance that the step size is adapted to.
ACCEPTANCE = 0.35
FIRST_STEP, SMALLEST_STEP, LARGEST_STEP = 0.5, 0.02, 0.9
# Hot rows that must be events before the search itself has come to gamma.
LEAST_EVENTS = 8
# Independent states that a chain is worth.
ESS_OF_A_CHAIN = 1.5
# Times the heaviest usual weight of the event, from which a state counts as not covered.
UNCOVERED_RATIO = 20.0
# Of the event's mass, that lies at weights up to the heaviest usual one.
USUAL_MASS = 0.95
_HOT_KIND, _MOVE_KIND = 0x686F7400, 0x636F6F6C


class ModeSearch(msgspec.Struct, frozen=True, eq=False):
    """How far a mode search has come.

    step: 0 before the hot rows, then 1 + moves made
    bound: gamma once the chains have begun or where the search has reached it, +inf before; in the unit of f
    chains: their present states, m of them
    step_size: of the moves, in (0, 1)
    visited: (h, d), states of the last KEPT_MOVES moves
    """

    step: int
    bound: float
    chains: Chains
    step_size: float
    visited: Array

    @property
    def over(self) -> bool:
        """Whether there is nothing left to propose."""
        return self.step > 0 and (self.chains.size == 0 or self.step > MOVES)


def init(dim: int, bound: float) -> ModeSearch:
    """The mode search before its first batch.

    dim: d
    bound: gamma where the search has reached it, +inf where it has not
    """
    return ModeSearch(0, bound, Chains.none(dim), FIRST_STEP, np.zeros((0, dim)))


def sizes(budget: int) -> tuple[int, int]:
    """Hot rows and chains for what the mode search may cost in all; (0, 0) where that is too little."""
    chains = min(int(CHAINS_SHARE * budget) // MOVES, MOST_CHAINS)
    return (min(int(HOT_SHARE * budget), MOST_HOT), chains) if chains >= LEAST_CHAINS else (0, 0)


def propose(state: ModeSearch, hot: int, seed: int, iteration: int) -> tuple[Array, NDArray[np.uint64]]:
    """u (n, d) and noise (n,) of the next batch, `hot` rows or a move of every chain."""
    if state.step > 0:
        return state.chains.proposed(generator(seed, _MOVE_KIND, "train", iteration, 0), state.step_size)
    d = state.visited.shape[1]
    source = generator(seed, _HOT_KIND, "train", iteration, 0)
    scale = np.geomspace(COOLEST, HOTTEST, hot)[:, None]
    z = source.standard_normal((hot, d))
    # Every other row is hot in some coordinates only: f may know nothing of points hot in all of many.
    share = source.random((hot, 1)) ** 2
    some = (source.random((hot, d)) < share) | (np.arange(hot)[:, None] % 2 == 0)
    return np.where(some, scale, 1.0) * z, source.bit_generator.random_raw(hot)


def update(
    state: ModeSearch,
    u: Array,
    noise: NDArray[np.uint64],
    f: Array,
    gamma: float,
    chains: int,
    seed: int,
    iteration: int,
) -> ModeSearch:
    """The mode search after a batch was answered.

    u: (n, d), the batch in standard-normal space
    noise: (n,), its rollouts' own seeds
    f: (n,), the answer, NaN = failed rollout
    gamma: threshold of the event, in the unit of f
    chains: to begin, after the hot rows
    seed: of the streams
    iteration: number of the batch
    """
    if state.step == 0:
        below = np.flatnonzero(f <= gamma)
        if below.size < (LEAST_EVENTS if state.bound > gamma else 1):
            return msgspec.structs.replace(state, step=1)
        rows = below[_spread(u[below], chains, generator(seed, _HOT_KIND, "train", iteration, 1))]
        rows = np.resize(rows, chains)
        begun = Chains(u[rows], f[rows], noise[rows], np.zeros(chains, dtype=np.int64))
        return msgspec.structs.replace(state, step=1, bound=gamma, chains=begun)
    accepted = f <= state.bound
    step_size = state.step_size * math.exp(
        (2.0 / math.sqrt(state.step)) * (float(np.mean(accepted)) - ACCEPTANCE)
    )
    moved = state.chains.moved(accepted, u, f, noise)
    kept = state.step > MOVES - KEPT_MOVES
    return msgspec.structs.replace(
        state,
        step=state.step + 1,
        chains=moved,
        step_size=min(max(step_size, SMALLEST_STEP), LARGEST_STEP),
        visited=np.concatenate([state.visited, moved.u]) if kept else state.visited,
    )


def _spread(u: Array, count: int, source: np.random.Generator) -> NDArray[np.intp]:
    """Rows of u (n, d) that point in different directions: k-means++ seeding on the unit sphere."""
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
    """Which states weigh far more than the event usually does where it was sampled: a proposal hardly comes there.

    log_w: (h,), log weights base / proposal of the states
    event_log_w: (e,), log weights of the event's samples
    """
    if event_log_w.size == 0:
        return np.ones(log_w.size, dtype=bool)
    order = np.argsort(event_log_w)
    mass = np.cumsum(np.exp(event_log_w[order] - event_log_w.max()))
    usual = float(
        event_log_w[order][int(np.searchsorted(mass, USUAL_MASS * mass[-1]).clip(0, order.size - 1))]
    )
    return log_w > usual + math.log(UNCOVERED_RATIO)
