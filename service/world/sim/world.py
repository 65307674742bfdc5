"""The controlled vehicles on a road: their state, what they perceive, and how they move. No SUMO in here."""

from dataclasses import dataclass

import numpy as np

from policies import layout
from policies.drivers import DriverModel
from policies.exactmath import normals_from_bits
from service.world import agents as A
from service.world.scenario import Scenario
from service.world.scenario.base import Start
from service.world.sensors.lidar import beam_directions
from service.world.sim import minds as M
from service.world.sim.human import advance_vehicles, reset_minds, traits_of
from service.world.sim.projection import place
from service.world.sim.road import Road
from service.world.sim.step import observe, write_poses


@dataclass(frozen=True)
class DriverNetwork:
    """The weights of the driver network that all rollouts share, and the scale of its actions.

    w1: (51, 200) float32
    b1: (200,) float32
    w2: (200, 100) float32
    b2: (100,) float32
    action_scale: (2,), m/s^2 and rad/s
    """

    w1: np.ndarray
    b1: np.ndarray
    w2: np.ndarray
    b2: np.ndarray
    action_scale: np.ndarray

    @classmethod
    def of(cls, drivers: DriverModel) -> "DriverNetwork":
        """The network of a driver model."""
        return cls(drivers.w1, drivers.b1, drivers.w2, drivers.b2, drivers.action_scale)


def action_noise(seed: int, steps: int, vehicles: int, channels: int = 2) -> np.ndarray:
    """Standard normals (steps, vehicles, channels) of a rollout: a Philox stream keyed by its seed.

    The bits are integers and the normal quantile is `policies.exactmath`, so they are the same on every processor.
    A shorter rollout's noise is a prefix of a longer one's.
    """
    bits = np.random.Philox(key=seed).random_raw(steps * vehicles * channels)
    normals = np.empty(bits.shape[0])
    normals_from_bits(bits, normals)
    return normals.reshape(steps, vehicles, channels)


class World:
    """The vehicles of one rollout; `ego` is a row or step.NO_EGO. Rows beyond `vehicles` are background traffic."""

    def __init__(
        self,
        road: Road,
        network: DriverNetwork,
        vehicles: int,
        ego: int,
        dt_s: float,
        rays: int = layout.BEAMS,
        background_rows: int = 0,
        traits: np.ndarray | None = None,
    ):
        """Make room for the vehicles of one rollout.

        traits: of human drivers (`service.world.sim.human`); None or empty: the network drives alone
        """
        self.road = road
        self.vehicles = vehicles
        self.ego = ego
        self.dt_s = dt_s
        self.agents = np.zeros((vehicles + background_rows, A.COLUMNS))
        self.count = vehicles
        self.observations = np.zeros((vehicles, layout.OBSERVATION_SIZE))
        self.poses = np.zeros((vehicles, 4))
        self.head = np.zeros(layout.HEAD_SIZE, np.float32)
        self.traits = np.zeros(0) if traits is None else traits
        self.minds = np.zeros((vehicles, M.COLUMNS))
        self.network = network
        self.beams = beam_directions(layout.BEAMS)
        self.rays = beam_directions(rays)

    @classmethod
    def of(
        cls,
        scenario: Scenario,
        road: Road,
        drivers: DriverModel,
        rays: int | None = None,
        background_rows: int = 0,
    ) -> "World":
        """The world of a scenario's rollouts; rays: of the measure, default the scenario's."""
        return cls(
            road,
            DriverNetwork.of(drivers),
            len(scenario.vehicles),
            scenario.ego,
            scenario.time.step_s,
            rays=scenario.safety.rays if rays is None else rays,
            background_rows=background_rows,
            traits=traits_of(scenario),
        )

    def reset(
        self, starts: list[Start], driver_weights: np.ndarray, reactions_s: np.ndarray | None = None
    ) -> None:
        """Put the vehicles at their starts; `driver_weights` (404,) is the last layer that drives the others.

        reactions_s (vehicles,): reaction times of human drivers.
        """
        self.agents[:] = 0.0
        self.observations[:] = 0.0
        self.head[:] = driver_weights
        for agent, start in zip(self.agents, starts, strict=False):
            agent[A.LENGTH_M] = start.length_m
            agent[A.WIDTH_M] = start.width_m
            agent[A.SPEED_MPS] = start.speed_mps
            agent[A.ACTIVE] = 1.0
            place(
                agent,
                start.station_m,
                start.lane,
                start.lane_offset_m,
                start.lane_heading_rad,
                self.road.reference,
                self.road.lanes,
                self.road.spacing_m,
            )
        self.count = self.vehicles
        if reactions_s is not None:
            reset_minds(self.minds, reactions_s)

    def observe(self) -> tuple[int, float]:
        """Update the observations; the ego's status (service.world.sim.step) and its time to collision in s."""
        return observe(
            self.agents,
            self.vehicles,
            self.count,
            self.ego,
            self.road.reference,
            self.road.lanes,
            self.road.spacing_m,
            self.beams,
            self.rays,
            self.observations,
        )

    def advance(self, acceleration_mps2: float, turn_rate_radps: float, action_noise: np.ndarray) -> None:
        """Move by one step; the arguments are the ego's action, `action_noise` (vehicles, 2) the others'.

        With human drivers it is (vehicles, 4), a row of `service.world.sim.latent`.
        """
        net, road = self.network, self.road
        advance_vehicles(
            self.agents, self.vehicles, self.count, self.ego, acceleration_mps2, turn_rate_radps, self.observations,
            net.w1, net.b1, net.w2, net.b2, self.head, net.action_scale, action_noise, self.dt_s, road.reference,
            road.lanes, road.spacing_m, self.minds, self.traits, self.poses,
        )  # fmt: skip

    def write_poses(self) -> None:
        """Update `poses` from the vehicles' state; `advance` does so by itself."""
        write_poses(self.agents, self.vehicles, self.road.lanes.shape[1], self.poses)
