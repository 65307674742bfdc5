"""What is fixed before paths are driven: how important a state is, and how many paths it deserves.

    I(state) = mean over the levels b of L_b(state) / E0 L_b          importance; E0 over the starts of the base
    kept     = min(1, max(I^beta_0, floor_0) / c_0)                   chance that a start is driven
    target   = c_t / max(I^beta_t, floor_t)                           weight that a path should have at a checkpoint

A committor L_b(state) = P(measure <= b later | state) that is off costs precision and nothing else: whatever is fixed
beforehand leaves the estimate unbiased.
"""

from collections.abc import Sequence
from typing import Protocol

import msgspec
import numpy as np
from numpy.typing import NDArray

from ce.paths import exactly

Array = NDArray[np.float64]

# Exponent of the importance, and populations by the share of the horizon that has passed.
BETA = 0.7
POPULATION_AT, POPULATION = (0.0, 0.05, 0.1, 0.15, 0.2, 0.3, 0.6), (2.0, 1.8, 1.5, 1.3, 1.1, 1.0, 0.8)
# Least I^beta that a state is given, over the mean of I^beta.
FLOOR = 0.4
# Least share of the mean of I^beta at the start that a later one is taken for.
LEAST_MEAN = 0.02
# A path is split where its weight is above SPLIT times the target, into at most MOST; it is at stake below ROULETTE.
SPLIT, ROULETTE, MOST = 1.6, 0.6, 20.0


class Committor(Protocol):
    """A fixed prediction of what a path will reach; its bits must be the same on every processor."""

    def log_hazard(self, features: NDArray[np.float32], levels: Array) -> Array:
        """log of the predicted number (n, L) of times that a state comes to each level; features (n, m, F)."""


class Plan(msgspec.Struct, frozen=True, eq=False):
    """A campaign's fixed numbers.

    gamma: the aimed level, in the unit of the measure; a path that has come to it is neither split nor ended any more
    levels: (L,), of the importance, falling, in the unit of the measure
    log_means: (L,), log E0 L_b
    beta: (T,), exponent at each checkpoint but the last
    log_floor: (T,), log of the least importance
    log_c: (T,), log c_t; the first is that of the starts
    """

    gamma: float
    levels: Array
    log_means: Array
    beta: Array
    log_floor: Array
    log_c: Array

    def log_importance(self, committor: Committor, features: NDArray[np.float32]) -> Array:
        """log I (n,) of states with those features (n, m, F)."""
        hazard = np.minimum(committor.log_hazard(features, self.levels), 0.0)
        return exactly.log_sum_exp(hazard - self.log_means, axis=1) - exactly.log(float(self.levels.size))

    def kept(self, log_importance: Array) -> tuple[Array, NDArray[np.bool_]]:
        """Chance (n,) that each start is driven, and which ones have it by the floor alone."""
        floored = np.maximum(log_importance, self.log_floor[0])
        chance = np.minimum(exactly.exp(self.beta[0] * floored - self.log_c[0]), 1.0)
        return chance, log_importance <= self.log_floor[0]

    def target(self, log_importance: Array, checkpoint: int) -> Array:
        """Weight (n,) that each path should have at the checkpoint of that number, 1 to T - 1."""
        floored = np.maximum(log_importance, self.log_floor[checkpoint])
        return exactly.exp(self.log_c[checkpoint] - self.beta[checkpoint] * floored)


def schedule(
    gamma: float,
    levels: Array,
    hazard: Array,
    checkpoints: tuple[int, ...],
    candidates: int,
    population: float,
    floor: float = FLOOR,
    seen: Sequence[tuple[Array, Array]] = (),
) -> Plan:
    """The plan by which `candidates` starts become about `population` paths.

    The floor and c_t go by the mean of I^beta at each checkpoint where paths have been seen there, and by that at
    the start elsewhere; the means are made to fall along the way and to stay above LEAST_MEAN of the first, as they
    are noisy.

    gamma: the aimed level, in the unit of the measure
    levels: (L,), of the importance, falling
    hazard: (n, L), log hazard of n starts drawn from the base
    checkpoints: steps, 0 first, the horizon last
    candidates: starts that will be drawn in a batch
    population: paths in the middle of the horizon
    floor: least I^beta over its mean
    seen: for each checkpoint from the second on, log hazard (k, L) of unbiased paths there and their weights (k,),
        which add
        up to the share of paths that are still open
    """
    hazard = np.minimum(hazard, 0.0)
    n = float(hazard.shape[0])
    log_means = exactly.log_sum_exp(hazard, axis=0) - exactly.log(n)

    def importance(of: Array) -> Array:
        shifted = np.minimum(of, 0.0) - log_means
        return exactly.log_sum_exp(shifted, axis=1) - exactly.log(float(levels.size))

    passed = np.array(checkpoints[:-1]) / checkpoints[-1]
    exponents, shares = np.full(passed.size, BETA), np.interp(passed, POPULATION_AT, POPULATION)
    at_start = importance(hazard)
    log_floor, log_c = np.empty(passed.size), np.empty(passed.size)
    falling = 1.0
    for k, (beta, size) in enumerate(zip(exponents, population * shares, strict=True)):
        powers = exactly.exp(beta * at_start)
        mean = float(np.add.reduce(powers)) / n
        least = floor * mean
        deserved = float(np.add.reduce(np.maximum(powers, least))) / n
        if 0 < k <= len(seen):
            here, weights = exactly.exp(beta * importance(seen[k - 1][0])), seen[k - 1][1]
            share = float(np.add.reduce(weights * here)) / mean
            falling = min(falling, max(share, LEAST_MEAN))
            least, top = floor * falling * mean, (1.0 + floor) * falling * mean
            found = float(np.add.reduce(weights * np.maximum(here, least)))
            deserved = min(max(found, falling * mean), top)
        log_floor[k] = exactly.log(least) / beta
        log_c[k] = exactly.log(candidates * deserved / size)
        if k == 0:
            log_c[k] = _capped(np.maximum(powers, least), float(log_c[k]), size / candidates)
    return Plan(gamma, levels, log_means, exponents, log_floor, log_c)


def _capped(powers: Array, log_c: float, share: float) -> float:
    """log c at which the mean of min(1, powers / c) is the share, at most 1."""
    if share >= 1.0:
        return float(exactly.log(float(powers.min())))
    c = float(exactly.exp(log_c))
    for _ in range(50):
        c *= float(np.add.reduce(np.minimum(1.0, powers / c))) / powers.size / share
    return float(exactly.log(c))
