"""Rollouts as one compiled call, without SUMO: the same bits as `service.world.sim.rollout`, at a fraction of the cost.

SUMO is told where the controlled vehicles are; it does not move them. Where nobody looks on (no background traffic, no
observers, no camera) and the ego is one of the compiled ones, a rollout can leave it out. Campaigns of 10^6 rollouts
do, and have a share of their rollouts run in SUMO too and compared bit for bit (`service.studies.reproduce`).
"""

import math
from typing import Any, NamedTuple

import numpy as np

from policies.drivers import DriverModel
from policies.egos import ego_names, ego_weights, load_ego
from policies.egos.compiled import IDM
from policies.egos.lidar import LidarEgo
from policies.egos.registry import LIDAR
from policies.jit import kernel
from service.closing import Closing
from service.errors import InputError
from service.world.safety.contact import contact_of
from service.world.safety.impact import time_or_impact
from service.world.scenario.noise import Noise
from service.world.scenario.schema import Scenario
from service.world.sim import step
from service.world.sim.road import road_of
from service.world.sim.rollout import OUTCOMES, Draw, Rollout
from service.world.sim.segment import IMPACT, RAYS, drive_on
from service.world.sim.step import observe
from service.world.sim.world import World
from sumo_nets.corridor import Corridor

MEASURES = {"ttc": RAYS, "ttc-impact": IMPACT}


def is_compiled(ego: str) -> bool:
    """Whether the ego of that name is one of `policies.egos.compiled`."""
    weights = ego_weights(ego)
    return ego == "idm" or (weights is not None and weights.suffix == LIDAR)


def compiled_egos() -> list[str]:
    """The names of all compiled egos that are shipped."""
    return [name for name in ego_names() if is_compiled(name)]


def can_leave_out_sumo(scenario: Scenario, ego: str) -> bool:
    """Whether this scenario's rollouts with this ego need no SUMO."""
    return is_compiled(ego) and scenario.safety.measure in MEASURES and scenario.background is None


@kernel
def drive(
    agents: np.ndarray, controlled: int, ego: int, ego_kind: int, ego_w1: np.ndarray, ego_b1: np.ndarray,
    ego_w2: np.ndarray, ego_b2: np.ndarray, ego_head: np.ndarray, ego_scale: np.ndarray, w1: np.ndarray, b1: np.ndarray,
    w2: np.ndarray, b2: np.ndarray, head: np.ndarray, scale: np.ndarray, action_noise: np.ndarray, dt_s: float,
    reference: np.ndarray, lanes: np.ndarray, spacing_m: float, beams: np.ndarray, rays: np.ndarray,
    observations: np.ndarray, poses: np.ndarray, measure: int, minds: np.ndarray, traits: np.ndarray,
) -> tuple[float, int, int]:  # fmt: skip
    """The smallest value of the measure, how the ego ended (service.world.sim.step) and the steps driven.

    The arguments are those of `service.world.sim.segment.drive_on`.
    """
    status, smallest = observe(
        agents, controlled, controlled, ego, reference, lanes, spacing_m, beams, rays, observations
    )
    if measure == IMPACT:
        smallest = time_or_impact(agents, controlled, ego)
    return drive_on(
        agents, controlled, ego, ego_kind, ego_w1, ego_b1, ego_w2, ego_b2, ego_head, ego_scale, w1, b1, w2, b2, head,
        scale, action_noise, dt_s, reference, lanes, spacing_m, beams, rays, observations, poses, measure, minds,
        traits, status, smallest,
    )  # fmt: skip


class Parts(NamedTuple):
    """What the kernels of a scenario with a compiled ego read.

    ego: kind and weights
    network: w1, b1, w2, b2 and scale of the drivers
    road: reference, lanes, spacing, beams and the measure's rays
    """

    ego: tuple[Any, ...]
    network: tuple[np.ndarray, ...]
    road: tuple[Any, ...]
    measure: int
    traits: np.ndarray


class WithoutSumo(Closing):
    """Runs rollouts of one scenario with a compiled ego; in place of `Simulator` where nobody looks on."""

    def __init__(self, scenario: Scenario, corridor: Corridor, drivers: DriverModel, ego: str):
        """InputError where the scenario or the ego needs SUMO."""
        if not can_leave_out_sumo(scenario, ego):
            raise InputError(
                f"scenario {scenario.name} with ego {ego!r} needs SUMO: what can do without are the egos "
                f"{', '.join(compiled_egos())}, with the measures {' and '.join(MEASURES)}, without background traffic"
            )
        self._scenario = scenario
        self._measure = MEASURES[scenario.safety.measure]
        self._world = World.of(scenario, road_of(corridor), drivers)
        self._network = self._world.network
        self._rays = self._world.rays if self._measure == RAYS else self._world.rays[:0]
        self._draw = Draw(scenario)
        policy = load_ego(ego)
        # the intelligent driver reads no weights; it is given the drivers' so that the kernel has one signature
        kind, own = (
            (policy.kind, policy.weights)
            if isinstance(policy, LidarEgo)
            else (IDM, self._drivers_weights(drivers))
        )
        self._ego = (kind, *own)

    @property
    def parts(self) -> Parts:
        """For kernels that drive many rollouts at once (`service.world.paths`)."""
        world, net = self._world, self._network
        road = (world.road.reference, world.road.lanes, world.road.spacing_m, world.beams, self._rays)
        drivers = (net.w1, net.b1, net.w2, net.b2, net.action_scale)
        return Parts(self._ego, drivers, road, self._measure, world.traits)

    def _drivers_weights(self, drivers: DriverModel) -> tuple[np.ndarray, ...]:
        n = self._network
        return n.w1, n.b1, n.w2, n.b2, drivers.mu0.astype(np.float32), n.action_scale

    in_sumo = 0  # rollouts that SUMO has driven

    @property
    def world(self) -> World:
        """Its vehicles, as the last rollout left them."""
        return self._world

    def close(self) -> None:
        """Nothing is held."""

    def begin_chunk(self) -> None:
        """The rollouts that come now are of a new chunk."""

    def run(self, x: np.ndarray, noise_seed: Noise = 0, *, action_noise: np.ndarray | None = None) -> Rollout:
        """The rollout of `x` (d,), with the same bits as `Simulator.run`."""
        world, net = self._world, self._network
        _, happens = self._draw.begin(world, x, noise_seed, action_noise)
        f, status, k = drive(
            world.agents, world.vehicles, world.ego, *self._ego, net.w1, net.b1, net.w2, net.b2, world.head,
            net.action_scale, happens, self._scenario.time.step_s, world.road.reference, world.road.lanes,
            world.road.spacing_m, world.beams, self._rays, world.observations, world.poses, self._measure, world.minds,
            world.traits,
        )  # fmt: skip
        if math.isnan(f):
            return Rollout(math.nan, "error", 0, "EgoError: the ego answered a number that is not finite")
        contact = contact_of(world.agents, world.count, world.ego) if status == step.COLLIDED else None
        return Rollout(f, OUTCOMES[status], k, contact=contact)
