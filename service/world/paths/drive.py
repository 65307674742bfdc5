"""States driven on, each with the noise of a key of its own."""

import numpy as np

from policies.jit import kernel
from service.world.paths.noise import happens_on
from service.world.sim import step
from service.world.sim.latent import CHANNELS
from service.world.sim.segment import drive_on
from service.world.sim.streams import REDRAWN


@kernel
def drive_all(
    keys: np.ndarray, until: int, ego: int, own: tuple, network: tuple, road: tuple, latent: tuple, dt_s: float,
    measure: int, traits: np.ndarray, agents: np.ndarray, observations: np.ndarray, minds: np.ndarray,
    noise: np.ndarray, causes: np.ndarray, heads: np.ndarray, smallest: np.ndarray, status: np.ndarray, at: np.ndarray,
    driven: np.ndarray,
) -> None:  # fmt: skip
    """Move the states on to step `until`, or to where they end.

    keys: (n,) uint64
    own: kind and weights of the ego, as `drive_on` has them; network: w1, b1, w2, b2 and scale of the drivers
    road: reference, lanes, spacing, beams, rays
    latent: `service.world.paths.noise.constants_of`
    """
    vehicles = agents.shape[1]
    human = traits.shape[0] > 0
    channels = CHANNELS if human else 2
    kind, ew1, eb1, ew2, eb2, ehead, escale = own
    w1, b1, w2, b2, scale = network
    reference, lanes, spacing_m, beams, rays = road
    poses = np.zeros((vehicles, 4))
    for r in range(at.size):
        driven[r] = 0
        steps = until - at[r]
        if status[r] != step.RUNNING or steps <= 0 or np.isnan(smallest[r]):
            continue
        words = np.empty(REDRAWN * causes.shape[1] + steps * vehicles * channels, np.uint64)
        normals = np.empty((steps, vehicles, channels))
        table = np.empty((steps, vehicles, channels)) if human else normals
        happens_on(keys[r], at[r], ego, causes[r], noise[r], *latent, words, normals, table)
        smallest[r], status[r], driven[r] = drive_on(
            agents[r], vehicles, ego, kind, ew1, eb1, ew2, eb2, ehead, escale, w1, b1, w2, b2, heads[r], scale, table,
            dt_s, reference, lanes, spacing_m, beams, rays, observations[r], poses, measure, minds[r], traits,
            status[r], smallest[r],
        )  # fmt: skip
        at[r] += driven[r]
