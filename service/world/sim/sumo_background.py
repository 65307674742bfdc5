"""Traffic that SUMO drives around the controlled vehicles: put on the road at the start, read back each step."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from policies.exactmath import sincos
from service.errors import SimulationError
from service.world import agents as A
from service.world.sim.drawn_lengths import stretch
from service.world.sim.sumo_library import CONSTANTS as TC
from sumo_nets.corridor import Corridor

ROUTE = "corridor"  # all of it
SUBSCRIBED = (TC.VAR_POSITION, TC.VAR_ANGLE, TC.VAR_SPEED, TC.VAR_LENGTH, TC.VAR_WIDTH, TC.VAR_LANE_ID)
BACKGROUND_TYPE = "background"
BACKGROUND_CLASS = "passenger"
CLEAR_BEFORE_M = 40.0  # background vehicles keep this far from where controlled vehicles can start
CLEAR_AFTER_M = 60.0
MINIMUM_SPACING_M = 15.0  # between background vehicles of a lane at the start


@dataclass(frozen=True)
class BackgroundTraffic:
    """Traffic that SUMO drives: how dense, how fast, and the stations to keep clear at the start."""

    density_veh_per_km_lane: float
    speed_mps: float
    clear_from_m: float
    clear_to_m: float
    horizon_s: float  # vehicles keep entering this long


def define(sumo: Any, traffic: BackgroundTraffic) -> None:
    """The vehicle type, which a load forgets."""
    sumo.vehicletype.copy("DEFAULT_VEHTYPE", BACKGROUND_TYPE)
    sumo.vehicletype.setVehicleClass(BACKGROUND_TYPE, BACKGROUND_CLASS)
    sumo.vehicletype.setMaxSpeed(BACKGROUND_TYPE, traffic.speed_mps)


def populate(
    sumo: Any, corridor: Corridor, traffic: BackgroundTraffic, generator: np.random.Generator
) -> None:
    """Background vehicles along the road, spaced exponentially, and their followers from its start."""
    free = corridor.lane_left.shape[0]
    for lane in range(free):
        exists = np.flatnonzero(corridor.sumo_lane[lane] >= 0)
        if exists.size < corridor.sumo_lane.shape[1]:
            continue  # ramps and auxiliary lanes stay empty
        if any(BACKGROUND_CLASS not in sumo.lane.getAllowed(name) for name in _lane_ids(corridor, lane)):
            continue  # a lane that is not for everybody (HOV), or for nobody: SUMO then gives an empty list
        mean_gap = max(1000.0 / traffic.density_veh_per_km_lane - MINIMUM_SPACING_M, 1.0)
        at = corridor.length_m - 10.0
        number = 0
        while True:
            at -= MINIMUM_SPACING_M + generator.exponential(mean_gap)
            if traffic.clear_from_m - CLEAR_BEFORE_M < at < traffic.clear_to_m + CLEAR_AFTER_M:
                continue
            if at < -traffic.horizon_s * traffic.speed_mps:
                break
            _add(sumo, corridor, traffic.speed_mps, f"background-{lane + 1}-{number}", lane, at)
            number += 1


def _add(sumo: Any, corridor: Corridor, speed: float, name: str, lane: int, station_m: float) -> None:
    """A background vehicle on the road, or one that enters it later if `station_m` lies before its start."""
    edge, sumo_lane = corridor.sumo_position(lane, max(station_m, 0.0))
    if station_m < 10.0:
        depart = f"{(10.0 - station_m) / speed:.3f}"
        sumo.vehicle.add(name, ROUTE, typeID=BACKGROUND_TYPE, depart=depart, departLane=str(sumo_lane),
                            departPos="10", departSpeed="max")  # fmt: skip
        return
    start, length = lane_extent(sumo, corridor, edge, sumo_lane)
    within = station_m - start
    route = route_from(sumo, corridor, edge)
    within /= stretch(sumo, f"{edge}_{sumo_lane}")
    if not 6.0 < within < length - 1.0:
        return  # too close to a junction to stand there
    sumo.vehicle.add(name, route, typeID=BACKGROUND_TYPE, departLane=str(sumo_lane),
                        departPos=f"{within:.2f}", departSpeed="max")  # fmt: skip


def read(
    sumo: Any, controlled: set[str], agents: np.ndarray, first: int, stretched: Callable[[str], float]
) -> int:
    """Write the vehicles that are not `controlled` into `agents` from row `first`; return the number of rows in use.

    stretched: metres as drawn in one of SUMO's, of a lane by its id
    """
    for name in sumo.simulation.getDepartedIDList():
        if name not in controlled:
            sumo.vehicle.subscribe(name, SUBSCRIBED)
    seen = sumo.vehicle.getAllSubscriptionResults()
    row = first
    for name in sorted(seen):
        if row == agents.shape[0]:
            raise SimulationError(
                f"more than {agents.shape[0] - first} background vehicles; lower the density"
            )
        values = seen[name]
        heading = (90.0 - values[TC.VAR_ANGLE]) * (math.pi / 180.0)
        sine, cosine = sincos(heading)
        length = values[TC.VAR_LENGTH]
        x, y = values[TC.VAR_POSITION]
        agents[row, A.X_M] = x - 0.5 * length * cosine
        agents[row, A.Y_M] = y - 0.5 * length * sine
        agents[row, A.HEADING_RAD] = heading
        agents[row, A.SPEED_MPS] = values[TC.VAR_SPEED] * stretched(values[TC.VAR_LANE_ID])
        agents[row, A.LENGTH_M] = length
        agents[row, A.WIDTH_M] = values[TC.VAR_WIDTH]
        agents[row, A.ACTIVE] = 1.0
        row += 1
    return row


def route_from(sumo: Any, corridor: Corridor, edge: str) -> str:
    """The route along the corridor that begins at an edge, made where SUMO has none yet."""
    index = corridor.edges.index(edge)
    route = f"{ROUTE}-from-{index}"
    if route not in sumo.route.getIDList():
        sumo.route.add(route, list(corridor.edges[index:]))
    return route


def lane_extent(sumo: Any, corridor: Corridor, edge: str, lane: int) -> tuple[float, float]:
    """First station and length (SUMO's m) of an edge's lane, by SUMO's number of it."""
    x, y = sumo.simulation.convert2D(edge, 0.0, lane)
    start, _ = corridor.project(np.array([x]), np.array([y]))
    return float(start[0]), sumo.lane.getLength(f"{edge}_{lane}")


def _lane_ids(corridor: Corridor, lane: int) -> list[str]:
    """SUMO's lanes of a lane that runs through, in driving order."""
    pairs = zip(corridor.edge_index[lane].tolist(), corridor.sumo_lane[lane].tolist(), strict=True)
    return [f"{corridor.edges[edge]}_{index}" for edge, index in dict.fromkeys(pairs)]
