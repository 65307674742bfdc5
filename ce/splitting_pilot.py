"""The pilot of splitting: an adaptive run that fixes the levels and the step sizes for the replications.

Levels are the p0-quantiles of the samples (Au and Beck, Probabilistic Engineering Mechanics 16, 2001); a coordinate's
step is in proportion to the spread of the seeds, with one factor for all that is adapted to the acceptance (aCS of
Papaioannou, Betz, Zwirglmaier and Straub, Probabilistic Engineering Mechanics 41, 2015).
"""

import math

import msgspec
import numpy as np
from numpy.typing import NDArray

from ce.chains import Chains
from ce.splitting_options import SplittingOptions
from ce.state import PilotState
from ce.weights import order_statistic

Array = NDArray[np.float64]

# Acceptance that the step factor is adapted to.
ACCEPTANCE = 0.44
SMALLEST_FACTOR, LARGEST_FACTOR = 1e-3, 3.0
SMALLEST_SPREAD = 0.05
# Seeds below which their spread says nothing.
LEAST_SEEDS = 10


def initial_pilot(size: int, dim: int) -> PilotState:
    """The pilot before any rollout."""
    return PilotState(size, 0, np.zeros(0), np.zeros((0, dim)), 0.6, np.zeros(0), False)


def pilot_steps(pilot: PilotState) -> Array:
    """Step sizes (d,) of the present level's next move."""
    steps: Array = np.minimum(pilot.step_factor * pilot.steps[-1], 1.0)
    return steps


def adapted(pilot: PilotState, accepted: float, chain_length: int) -> PilotState:
    """The pilot after a move of which that share was accepted, from chains of that many states."""
    gain = 2.0 / math.sqrt(chain_length)
    factor = pilot.step_factor * math.exp(gain * (accepted - ACCEPTANCE))
    return msgspec.structs.replace(pilot, step_factor=min(max(factor, SMALLEST_FACTOR), LARGEST_FACTOR))


def next_level(
    pilot: PilotState, number: int, sample: Chains, gamma: float, options: SplittingOptions
) -> tuple[PilotState, NDArray[np.intp] | None]:
    """The pilot after level `number` and its sample, and the rows to grow from, None when it is over."""
    f = np.where(np.isnan(sample.f), math.inf, sample.f)
    level = _next_threshold(f, pilot.levels, options.p0)
    # Settled steps of the level just sampled replace its first guess.
    steps = np.vstack([pilot.steps[:-1], pilot_steps(pilot)]) if number else pilot.steps
    cost = (options.chain - 1) * (pilot.size // options.chain)
    stuck = not level > -math.inf
    spent = pilot.rollouts + cost > options.pilot_share * options.budget
    if level <= gamma or stuck or spent:
        levels = np.append(pilot.levels, gamma)
        reached = level <= gamma and not stuck
        return msgspec.structs.replace(pilot, levels=levels, steps=steps, reached=reached), None
    alive = np.flatnonzero(f <= level)
    spread = sample.u[alive].std(axis=0) if alive.size > LEAST_SEEDS else np.ones(sample.u.shape[1])
    return (
        msgspec.structs.replace(
            pilot,
            levels=np.append(pilot.levels, level),
            steps=np.vstack([steps, np.clip(spread, SMALLEST_SPREAD, 1.0)]),
        ),
        alive,
    )


def _next_threshold(f: Array, levels: Array, p0: float) -> float:
    """The p0-quantile of f (n,), or the highest value below where that is infinite or a plateau at the last level."""
    level = order_statistic(f, p0)
    if not level < math.inf:
        level = float(np.max(f[f < math.inf], initial=-math.inf))
    last = levels[-1] if levels.size else math.inf
    if level >= last:
        level = float(np.max(f[f < last], initial=-math.inf))
    return level


def spaced_rows(rows: NDArray[np.intp], seeds: int, source: np.random.Generator) -> NDArray[np.intp]:
    """`seeds` of the rows, evenly spaced in a random order."""
    rows = source.permutation(rows)
    return rows[(np.arange(seeds) * rows.size // seeds)]
