"""Vehicles that move as a test says, seen as a trace; no SUMO."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import pytest

from policies import layout
from policies.drivers import DriverModel
from service.analysis.trace import Trace
from service.world import agents as A
from service.world.scenario.base import Start
from service.world.sim import step
from service.world.sim.road import road_of
from service.world.sim.rollout import Rollout
from service.world.sim.world import DriverNetwork, World
from sumo_nets.corridor import Corridor

STEP_S = 0.1


@dataclass(frozen=True)
class Moves:
    """A vehicle: its lane, and where it is along the road and left of that lane's centre, both m, at a time in s."""

    lane: int
    along: Callable[[float], float]
    left: Callable[[float], float] = lambda t: 0.0


def at_speed(start_m: float, speed_mps: float, acceleration_mps2: float = 0.0) -> Callable[[float], float]:
    return lambda t: start_m + speed_mps * t + 0.5 * acceleration_mps2 * t * t


def across(lanes_left: float, begin_s: float, takes_s: float = 3.0) -> Callable[[float], float]:
    """A steady change of so many lanes."""
    return lambda t: 3.6 * lanes_left * min(max((t - begin_s) / takes_s, 0.0), 1.0)


def still(t: float) -> float:
    return 0.0


@pytest.fixture(scope="session")
def play(i80: Corridor, drivers: DriverModel) -> Callable[..., Trace]:
    """play([ego, other, ...], seconds): the trace, to the ego's collision at the latest."""
    network = DriverNetwork.of(drivers)

    def run(vehicles: Sequence[Moves], seconds: float = 6.0) -> Trace:
        world = World(road_of(i80), network, len(vehicles), 0, STEP_S)
        times, agents, ttc = [], [], []
        for k in range(round(seconds / STEP_S) + 1):
            t = k * STEP_S
            world.reset([_start(v, t) for v in vehicles], np.zeros(layout.HEAD_SIZE))
            status, ttc_s = world.observe()
            for row, vehicle in enumerate(vehicles):
                world.agents[row, A.ACCELERATION_MPS2] = (
                    vehicle.along(t + STEP_S) - 2.0 * vehicle.along(t) + vehicle.along(t - STEP_S)
                ) / STEP_S**2
            times.append(t)
            agents.append(world.agents.copy())
            ttc.append(ttc_s)
            if status == step.COLLIDED:
                break
        return Trace(
            names=tuple(f"v{i}" for i in range(len(vehicles))),
            ego=0,
            time_s=np.array(times),
            agents=np.array(agents),
            ttc_s=np.array(ttc),
            actions=np.zeros((len(times) - 1, 2)),
            station_spacing_m=float(i80.ds_m),
            rollout=Rollout(min(ttc), "collision" if status == step.COLLIDED else "horizon", len(times) - 1),
            measure="ttc",
            measured=np.array(ttc),
        )

    return run


def _start(vehicle: Moves, t: float) -> Start:
    dt = 1e-3
    forward = (vehicle.along(t + dt) - vehicle.along(t - dt)) / (2 * dt)
    sideways = (vehicle.left(t + dt) - vehicle.left(t - dt)) / (2 * dt)
    return Start(
        station_m=vehicle.along(t),
        lane=vehicle.lane,
        lane_offset_m=vehicle.left(t),
        lane_heading_rad=math.atan2(sideways, forward),
        speed_mps=math.hypot(forward, sideways),
        length_m=4.5,
        width_m=1.8,
    )
