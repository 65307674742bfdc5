"""The replications of splitting: independent runs with fixed levels and steps, a group of them side by side.

Each of them is unbiased for p (Del Moral, Feynman-Kac Formulae, 2004, section 7.4).
"""

import math

import msgspec
import numpy as np
from numpy.typing import NDArray

from ce.chains import Chains
from ce.splitting_options import LARGEST_REPLICATION, MOST_HELD, SplittingOptions
from ce.state import PilotState, ReplicationsState

Array = NDArray[np.float64]


def no_replications() -> ReplicationsState:
    """What there is of them during the pilot."""
    nothing = np.zeros(0)
    return ReplicationsState(0, 0, 1, 0, np.zeros(1), nothing, nothing, np.zeros(0, dtype=np.int64))


def planned(pilot: PilotState, options: SplittingOptions) -> ReplicationsState:
    """Replications of equal size that fill the budget that the pilot has left; of size 0 where that is too little."""
    o = options
    moves = (1.0 - 1.0 / o.chain) * (pilot.levels.size - 1)
    total = (o.budget - pilot.rollouts) / (1.0 + moves)
    count = o.replications * max(math.ceil(total / o.replications / LARGEST_REPLICATION), 1)
    size = max(int(total / count) // o.chain * o.chain, 0)
    most = max(MOST_HELD // max(size, o.chain), 1)
    between_looks = count // o.interim_looks
    group_size = max(k for k in range(1, between_looks + 1) if between_looks % k == 0 and k <= most)
    return msgspec.structs.replace(
        no_replications(), size=size, count=count, group_size=group_size, log_p=np.zeros(group_size)
    )


def with_values(state: ReplicationsState, chains: Chains) -> ReplicationsState:
    """The replications with the chains' present states among their weighted values."""
    return msgspec.structs.replace(
        state,
        f=np.concatenate([state.f, chains.f]),
        log_weights=np.concatenate(
            [state.log_weights, state.log_p[chains.replication] - math.log(state.size)]
        ),
        replication=np.concatenate([state.replication, _first(state) + chains.replication]),
    )


def next_group(state: ReplicationsState) -> ReplicationsState:
    """The replications with the next group before its first batch."""
    return msgspec.structs.replace(state, group=state.group + 1, log_p=np.zeros(state.group_size))


def finished(state: ReplicationsState) -> ReplicationsState:
    """The replications without those of the present group, whose levels are still to come: a running estimate made of
    them, too, would begin anew with every group."""
    whole = state.replication < _first(state)
    return msgspec.structs.replace(
        state, f=state.f[whole], log_weights=state.log_weights[whole], replication=state.replication[whole]
    )


def next_level(state: ReplicationsState, survivors: Chains, bound: float) -> ReplicationsState:
    """The replications when a level's survivors are handed on to the next level; the others keep their weights.

    state: with the level complete
    survivors: rows of the level with f <= bound
    bound: the next level, in the unit of f
    """
    counts = np.bincount(survivors.replication, minlength=state.group_size)
    with np.errstate(divide="ignore"):
        log_p = state.log_p + np.log(counts / state.size)
    stay = ~((state.replication >= _first(state)) & (state.f <= bound))
    return msgspec.structs.replace(
        state,
        log_p=log_p,
        f=state.f[stay],
        log_weights=state.log_weights[stay],
        replication=state.replication[stay],
    )


def resampled(replication: NDArray[np.int64], seeds: int, source: np.random.Generator) -> NDArray[np.intp]:
    """Rows of the survivors to grow from: `seeds` of each replication by systematic resampling from its own."""
    chosen = []
    for run in np.unique(replication):
        own = source.permutation(np.flatnonzero(replication == run))
        at = (np.arange(seeds) + source.random()) * own.size / seeds
        chosen.append(own[np.minimum(at.astype(np.intp), own.size - 1)])
    return np.concatenate(chosen)


def _first(state: ReplicationsState) -> int:
    """Number of the first replication of the present group."""
    return state.group * state.group_size
