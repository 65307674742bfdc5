"""A reference driver at the ego's wheel: braking by `policies.references`, steering back to the middle of the lane."""

import math

import numpy as np

from policies.egos import Observation
from policies.idm import lane_keeping_turn_rate
from policies.references import Other, Own, ReferenceDriver
from service.errors import EgoError
from service.world import agents as A
from service.world.safety.lane_frame import beside
from service.world.sim.world import World


class ReferenceEgo:
    """Drives the ego as a reference driver would: it sees every vehicle without error, background traffic included.

    It brakes to a standstill and does not roll back; it keeps the lane in which it finds itself.
    """

    begins_at_onset = True  # its clocks start when it takes over

    def __init__(self, driver: ReferenceDriver, step_s: float):
        self.name = driver.name
        self._driver = driver
        self._step_s = step_s
        self._world: World | None = None

    def see_world(self, world: World) -> None:
        """The world that it looks at; the simulator hands it over before the first rollout."""
        self._world = world

    def reset(self, seed: int) -> None:
        self._driver.reset()

    def act(self, observation: Observation) -> tuple[float, float]:
        world = self._world
        if world is None:
            raise EgoError(f"reference driver {self.name!r} sees the world itself, and none was handed to it")
        me = world.agents[world.ego]
        others = others_of(world.agents, world.count, world.vehicles, world.ego)
        own = Own(_along(me), float(me[A.ACCELERATION_MPS2]))
        acceleration = self._driver.act(own, others, self._step_s)
        still = -max(float(me[A.SPEED_MPS]), 0.0) / self._step_s
        return max(acceleration, still), lane_keeping_turn_rate(observation.vector)


def _along(agent: np.ndarray) -> float:
    """Speed along the vehicle's own lane, m/s."""
    return float(agent[A.SPEED_MPS]) * math.cos(float(agent[A.LANE_HEADING_RAD]))


def others_of(agents: np.ndarray, count: int, located: int, ego: int) -> list[Other]:
    """The active vehicles as the driver of row `ego` sees them.

    located: rows from which on there is background traffic, whose lanes are not known: it is seen once it is in the way
    """
    found = []
    for j in range(count):
        if j == ego or agents[j, A.ACTIVE] == 0.0:
            continue
        ahead, across, gap_along, gap_across, _, my_across, speed, speed_across = beside(agents, ego, j)
        side = 1.0 if across > 0.0 else -1.0
        towards = -side * agents[j, A.LANE_OFFSET_M] if j < located else 0.0
        if j < located and agents[j, A.LANE] == agents[ego, A.LANE]:
            towards = math.inf
        lengths = 0.5 * (agents[ego, A.LENGTH_M] + agents[j, A.LENGTH_M])
        found.append(
            Other(
                ahead >= 0.0,
                float(gap_along),
                float(gap_across),
                float(speed),
                float(side * (my_across - speed_across)),
                float(towards),
                float(lengths),
            )
        )
    return found
