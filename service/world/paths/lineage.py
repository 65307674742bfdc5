"""The draw and the noise that a path stands for: with them the whole of it is driven again, in any world.

A path is known by the draw and the seed of its root and the keys of its segments. `drawn` makes of them what
`service.world.sim.rollout.Simulator.run` takes: the x that holds the causes as they came about, and all standard
normals. The rollout of both has the bits of the path.
"""

import msgspec
import numpy as np

from service.world.paths.begin import Layout
from service.world.paths.noise import REDRAWN, happens_on
from service.world.paths.states import CAUSES, NOISES
from service.world.scenario.causes import MODES
from service.world.scenario.schema import Scenario
from service.world.sim.latent import CHANNELS, Latent


class Lineage(msgspec.Struct, frozen=True):
    """The keys of a path's segments, and the step at which each begins."""

    begins: tuple[int, ...]
    keys: tuple[int, ...]


def drawn(
    scenario: Scenario, layout: Layout, latent: tuple, x: np.ndarray, lineage: Lineage
) -> tuple[np.ndarray, np.ndarray]:
    """x (d,) with the causes of the path, and its normals (steps, vehicles, channels).

    x: of the root
    latent: `service.world.paths.noise.constants_of`

    The last segment's stream goes on to the horizon, so that a path that ended early has its noise all the same.
    """
    vehicles, steps = len(scenario.vehicles), scenario.steps
    human = scenario.human is not None
    channels = CHANNELS if human else 2
    others = [i for i in range(vehicles) if i != layout.ego]
    causes = np.zeros((vehicles if human else 0, CAUSES))
    noise = np.zeros((vehicles if human else 0, NOISES))
    columns = layout.first_cause + layout.width * np.arange(len(others))
    if human:
        causes[others] = x[columns[:, None] + np.arange(CAUSES)]
    parts, tables = [], []
    ends = (*lineage.begins[1:], steps)
    for begin, end, key in zip(lineage.begins, ends, lineage.keys, strict=True):
        normals = np.empty((end - begin, vehicles, channels))
        table = np.empty_like(normals)
        words = np.empty(REDRAWN * causes.shape[0] + normals.size, np.uint64)
        happens_on(np.uint64(key), begin, layout.ego, causes, noise, *latent, words, normals, table)
        parts.append(normals)
        tables.append(table)
    normals = np.concatenate(parts)
    if not human:
        return x.copy(), normals
    found = x.copy()
    found[columns[:, None] + np.arange(CAUSES)] = causes[others]
    found[columns[:, None] + np.arange(MODES, layout.width)] = _modes(scenario, normals)[others]
    return found, normals


def _modes(scenario: Scenario, normals: np.ndarray) -> np.ndarray:
    """The modes' coordinates (vehicles, columns) that the noise of these normals has by itself."""
    return Latent(scenario).modes_in(normals).reshape(len(scenario.vehicles), -1)
