"""What makes drivers err, as named coordinates of X: a few numbers of each environment vehicle.

    env4.reaction_s              reaction time to a conflict, lognormal
    env4.glance_onset_s          when its first long glance off the road begins; exponential, often beyond the horizon
    env4.glance_duration_s       how long that lasts: the tail of the lognormal of all glances beyond `long_s`
    env4.glance_leak             uniform on (0, 1): below epsilon it begins even in a conflict
    env4.acceleration_mode_1     a slow movement of the driver's noise over the first `window_s`, standard normal: ...
    env4.turn_rate_mode_1        ... mode 1 to one side (more gas, further to the left), mode 2 one way, then back

Shorter glances, later long ones and the rest of the noise come from the rollout's seed: in the first 10 s a driver
has a long glance with probability 0.2 and hardly ever two; over 400 s glances come by the hundred, and the
coordinates describe the first long one and the first `window_s` only.
"""

import math

import numpy as np
from scipy.special import ndtr

import ce
from service.world.scenario.schema import Glances, Scenario

# columns; those from MODES on are modes
REACTION_S, GLANCE_ONSET_S, GLANCE_DURATION_S, GLANCE_LEAK, MODES = range(5)
KINDS = ("reaction_s", "glance_onset_s", "glance_duration_s", "glance_leak")
ACTIONS = ("acceleration", "turn_rate")
FARTHEST_MODE = 8.0  # standard deviations
GRID = 2.0**-20  # seconds and shares: the last bits of a distribution's inverse may differ between processors
LEAST_SHARE_LONG = 1e-6


def share_long(glances: Glances) -> float:
    """The share of glances that last at least `long_s`."""
    return float(ndtr(-math.log(glances.long_s / glances.median_s) / glances.sigma))


def kinds(scenario: Scenario) -> list[str]:
    """The names of a vehicle's causes."""
    if scenario.human is None:
        return []
    modes = [f"{action}_mode_{m + 1}" for action in ACTIONS for m in range(scenario.human.noise.modes)]
    return [*KINDS, *modes]


def cause_names(scenario: Scenario) -> list[str]:
    """Names of the coordinates, in their order; none without a human table."""
    own = kinds(scenario)
    return [f"{v.name}.{kind}" for v in scenario.vehicles if v.role != "ego" for kind in own] if own else []


def marginals_of_causes(scenario: Scenario) -> list[ce.Marginal]:
    """Their distributions under P0, in the same order."""
    human = scenario.human
    if human is None:
        return []
    glances, reaction = human.glances, human.reaction
    one: list[ce.Marginal] = [
        ce.LogNormal(math.log(reaction.median_s), reaction.sigma),
        ce.Exponential(share_long(glances) / glances.every_s),
        ce.TruncatedLogNormal(math.log(glances.median_s), glances.sigma, glances.long_s),
        ce.Uniform(0.0, 1.0),
    ]
    mode = ce.TruncatedNormal(0.0, 1.0, -FARTHEST_MODE, FARTHEST_MODE)
    one += [mode] * (len(ACTIONS) * human.noise.modes)
    return one * sum(v.role != "ego" for v in scenario.vehicles)


def causes_of(scenario: Scenario, values: np.ndarray) -> np.ndarray:
    """Table (vehicles, columns) of the coordinates `values`; the ego's row is zero, as it has none."""
    width = len(kinds(scenario))
    table = np.zeros((len(scenario.vehicles), width))
    others = [i for i, v in enumerate(scenario.vehicles) if v.role != "ego"]
    if width:
        table[others] = values.reshape(len(others), width)
        table[:, :MODES] = np.round(table[:, :MODES] / GRID) * GRID
    return table
