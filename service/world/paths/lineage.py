"""The draw that a path stands for: with its noise the whole of it is driven again, in any world.

A path is known by the draw of its root and its noise, the keys of its segments. The draw that `draw_of` makes of them
holds the causes as they came about: the rollout of it and of the noise has the bits of the path.
"""

import numpy as np

from service.world.paths.begin import Layout
from service.world.paths.noise import happens_on
from service.world.paths.states import CAUSES, NOISES
from service.world.scenario.causes import MODES
from service.world.scenario.noise import PathNoise
from service.world.scenario.schema import Scenario
from service.world.sim.latent import CHANNELS, Latent
from service.world.sim.streams import REDRAWN


def draw_of(
    scenario: Scenario,
    layout: Layout,
    latent: Latent | None,
    constants: tuple,
    x: np.ndarray,
    noise: PathNoise,
) -> np.ndarray:
    """x (d,) with the causes of the path.

    latent: of human drivers; None for others, whose draw stays as it is
    constants: `service.world.paths.noise.constants_of`
    x: of the root
    """
    if latent is None:
        return x.copy()
    vehicles, steps = len(scenario.vehicles), scenario.steps
    others = [i for i in range(vehicles) if i != layout.ego]
    columns = layout.first_cause + layout.width * np.arange(len(others))
    causes, state = np.zeros((vehicles, CAUSES)), np.zeros((vehicles, NOISES))
    causes[others] = x[columns[:, None] + np.arange(CAUSES)]
    parts = []
    for begin, end, key in zip(noise.begins, (*noise.begins[1:], steps), noise.keys, strict=True):
        normals = np.empty((end - begin, vehicles, CHANNELS))
        words = np.empty(REDRAWN * vehicles + normals.size, np.uint64)
        happens_on(
            np.uint64(key),
            begin,
            layout.ego,
            causes,
            state,
            *constants,
            words,
            normals,
            np.empty_like(normals),
        )
        parts.append(normals)
    found = x.copy()
    found[columns[:, None] + np.arange(CAUSES)] = causes[others]
    modes = latent.modes_in(np.concatenate(parts)).reshape(vehicles, -1)
    found[columns[:, None] + np.arange(MODES, layout.width)] = modes[others]
    return found
