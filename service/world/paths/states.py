"""The state of many rollouts between two steps: all that decides how they go on, except the noise to come."""

from dataclasses import dataclass, fields

import numpy as np

from policies import layout
from service.world import agents as A
from service.world.sim import minds as M

LAST, BEFORE = 0, 2  # columns of `noise`: acceleration and turn rate of the last step, and of the step before
NOISES = 4
CAUSES = 4  # of a driver, as `service.world.scenario.causes` has them, without its modes


@dataclass(frozen=True)
class States:
    """Arrays with a row a rollout; v vehicles.

    agents: (n, v, columns of `service.world.agents`)
    observations: (n, v, 51)
    minds: (n, v, columns of `service.world.sim.minds`); v = 0 where the drivers are not human, as of the next two
    noise: (n, v, 4) of unit variance, before amplitudes
    causes: (n, v, 4): reaction time, and onset, duration and leak of the long glance that comes next or has been
    heads: (n, 404) float32, the last layer that drives the others
    smallest: (n,) value of the measure so far; NaN where the ego failed
    nearest: (n,) smallest level at a checkpoint so far (`service.world.paths.level`)
    status: (n,) how the ego stands (`service.world.sim.step`)
    at: (n,) steps from the start
    driven: (n,) of these in the last call of `advance`
    """

    agents: np.ndarray
    observations: np.ndarray
    minds: np.ndarray
    noise: np.ndarray
    causes: np.ndarray
    heads: np.ndarray
    smallest: np.ndarray
    nearest: np.ndarray
    status: np.ndarray
    at: np.ndarray
    driven: np.ndarray

    def __len__(self) -> int:
        return int(self.at.size)

    def take(self, rows: np.ndarray) -> "States":
        """Copies of these rows, which may repeat."""
        return States(*(getattr(self, f.name)[rows] for f in fields(self)))


def empty_states(n: int, vehicles: int, human: bool) -> States:
    """Room for n rollouts, all zero."""
    minded = vehicles if human else 0
    return States(
        agents=np.zeros((n, vehicles, A.COLUMNS)),
        observations=np.zeros((n, vehicles, layout.OBSERVATION_SIZE)),
        minds=np.zeros((n, minded, M.COLUMNS)),
        noise=np.zeros((n, minded, NOISES)),
        causes=np.zeros((n, minded, CAUSES)),
        heads=np.zeros((n, layout.HEAD_SIZE), np.float32),
        smallest=np.zeros(n),
        nearest=np.full(n, np.inf),
        status=np.zeros(n, np.int64),
        at=np.zeros(n, np.int64),
        driven=np.zeros(n, np.int64),
    )
