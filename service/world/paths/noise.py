"""What drivers do in the steps of a segment, from its key: standard normals as they are, or human drivers' table.

A driver's causes are drawn anew where they lie ahead. Of the long glance that `service.world.scenario.causes` names
this is so until it begins: its onset is exponential, so that what is left of the wait has its law whatever has passed.
The modes of the noise are not held fixed at all: the noise goes on by its recursion, which has the same law, and what
they came to is found from the whole path (`lineage`). So a state knows nothing of what is to come, and copies of it go
different ways from the next step on.
"""

import math
from typing import Any

import numpy as np

from policies.exactmath import exp, log, normal_quantile
from policies.jit import kernel
from service.world.paths.states import BEFORE, LAST
from service.world.scenario.causes import GLANCE_DURATION_S, GLANCE_LEAK, GLANCE_ONSET_S, GRID, share_long
from service.world.scenario.schema import Scenario
from service.world.sim.latent import (
    GLANCE,
    LEAK,
    Latent,
    glance_of,
    next_noise,
    recursion,
)
from service.world.sim.streams import REDRAWN, fill_normals, uniform, words


@kernel
def rounded(value: float) -> float:
    """On the grid that `causes_of` uses: the same bits on every processor."""
    return np.rint(value / GRID) * GRID


@kernel
def redraw(
    causes: np.ndarray, ego: int, at: int, dt_s: float, long_rate: float, share: float, median_s: float, sigma: float,
    words_: np.ndarray,
) -> None:  # fmt: skip
    """Draw anew the long glances of `causes` (vehicles, 4) that have not begun before step `at`.

    words_: (vehicles * 3,); long_rate: of long glances, per s; share: of glances that are long
    """
    for i in range(causes.shape[0]):
        if i == ego or int(rounded(causes[i, GLANCE_ONSET_S]) / dt_s) < at:
            continue
        onset = at * dt_s - log(uniform(words_[REDRAWN * i])) / long_rate
        while int(rounded(onset) / dt_s) < at:  # a last bit before the step
            onset += GRID
        causes[i, GLANCE_ONSET_S] = onset
        causes[i, GLANCE_DURATION_S] = median_s * exp(
            -sigma * normal_quantile(share * uniform(words_[REDRAWN * i + 1]))
        )
        causes[i, GLANCE_LEAK] = uniform(words_[REDRAWN * i + 2])


@kernel
def realise_on(
    normals: np.ndarray, causes: np.ndarray, noise: np.ndarray, at: int, ego: int, decays: np.ndarray,
    amplitudes: np.ndarray, dt_s: float, hazard: float, median_s: float, sigma: float, long_s: float, leak_below: float,
    leak_share: float, table: np.ndarray,
) -> None:  # fmt: skip
    """Fill `table` (steps, vehicles, 4) for the steps from `at` on, as `service.world.sim.latent` does for all of them.

    noise: (vehicles, 4) of the last two steps, moved on
    """
    steps, vehicles = normals.shape[0], normals.shape[1]
    for i in range(vehicles):
        if i == ego:
            table[:, i, :] = 0.0
            continue
        for c in range(2):
            constants = recursion(decays[c])
            last, before = noise[i, LAST + c], noise[i, BEFORE + c]
            for k in range(steps):
                value = next_noise(at + k, normals[k, i, c], last, before, constants)
                last, before = value, last
                table[k, i, c] = value * amplitudes[c]
            noise[i, LAST + c], noise[i, BEFORE + c] = last, before
        onset, duration = rounded(causes[i, GLANCE_ONSET_S]), rounded(causes[i, GLANCE_DURATION_S])
        for k in range(steps):
            table[k, i, LEAK] = 1.0 if normals[k, i, LEAK] < leak_below else 0.0
            table[k, i, GLANCE] = glance_of(
                normals[k, i, GLANCE], (at + k) * dt_s, onset + duration, hazard, median_s, sigma, long_s
            )
        begins = onset / dt_s
        if begins < at + steps and int(begins) >= at:
            table[int(begins) - at, i, GLANCE] = duration
            table[int(begins) - at, i, LEAK] = 1.0 if rounded(causes[i, GLANCE_LEAK]) < leak_share else 0.0


@kernel
def happens_on(
    key: np.uint64, at: int, ego: int, causes: np.ndarray, noise: np.ndarray, long_rate: float, share: float,
    decays: np.ndarray, amplitudes: np.ndarray, dt_s: float, hazard: float, median_s: float, sigma: float,
    long_s: float, leak_below: float, leak_share: float, words_: np.ndarray, normals: np.ndarray, table: np.ndarray,
) -> None:  # fmt: skip
    """Fill `normals` and `table` of a segment from its key; causes and noise (vehicles, 4) are moved on.

    Drivers who are not human have causes of 0 rows, and `normals` are all that happens. Causes of a path at its start
    are those of its draw.
    """
    words(key, words_)
    first = REDRAWN * causes.shape[0]
    fill_normals(words_[first:], normals)
    if causes.shape[0] > 0:
        if at > 0:
            redraw(causes, ego, at, dt_s, long_rate, share, median_s, sigma, words_[:first])
        realise_on(
            normals, causes, noise, at, ego, decays, amplitudes, dt_s, hazard, median_s, sigma, long_s, leak_below,
            leak_share, table,
        )  # fmt: skip


def constants_of(scenario: Scenario, latent: Latent | None) -> tuple[Any, ...]:
    """What `happens_on` reads from `long_rate` to `leak_share`; of drivers who are not human nothing is read but the
    step."""
    if scenario.human is None or latent is None:
        none = np.zeros(2)
        return 1.0, 1.0, none, none, scenario.time.step_s, 1.0, 1.0, 1.0, 1.0, -math.inf, 0.0
    glances = scenario.human.glances
    share = share_long(glances)
    return share / glances.every_s, share, *latent.fixed[2:]
