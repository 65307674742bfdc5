"""Traffic in SUMO for the realism card: vehicles that SUMO's own driver drives among others that are put where they are
told. Unlike in rollouts, SUMO keeps the lanes and positions of all of them."""

from collections.abc import Sequence

import numpy as np

from service.world.sim.sumo import CONTROLLED_CLASS, UNCHECKED, lane_hints
from service.world.sim.sumo_background import BACKGROUND_CLASS, lane_extent, route_from
from service.world.sim.sumo_library import close_simulation, open_simulation, options_for
from sumo_nets.corridor import Corridor


class SumoTraffic:
    """Vehicles that SUMO's own driver (Krauss) drives among others that are placed at each step; a context manager.

    SUMO knows lanes and positions along them: a vehicle that is changing lanes is in the middle of one or the other.
    """

    def __init__(self, corridor: Corridor, step_s: float, seed: int, insert_anyhow: bool = True):
        """Begin a simulation of an empty road.

        insert_anyhow: vehicles appear where they are added; otherwise when SUMO finds it safe
        """
        self._corridor = corridor
        options = [*options_for(corridor.net_path, step_s), "--seed", str(seed % 2**31)]
        if insert_anyhow:
            options += ["--insertion-checks", "none"]
        self._hints = lane_hints(corridor)
        self._extent: dict[
            tuple[str, int], tuple[float, float]
        ] = {}  # an edge's lane: first station, length (m)
        self._length: dict[str, float] = {}
        self.seen = 0  # vehicles that have entered the road
        self._sumo = open_simulation(self, options)

    def __enter__(self) -> "SumoTraffic":
        return self

    def __exit__(self, *_: object) -> None:
        close_simulation(self)

    def clear(self) -> None:
        """Take all vehicles out."""
        for name in self._sumo.vehicle.getIDList():
            self._sumo.vehicle.remove(name)
        self._sumo.simulationStep()
        self._length = {}

    def add(
        self, name: str, length: float, width: float, lane: int, station: float, speed: float, placed: bool
    ) -> None:
        """A vehicle whose centre is at `station` (m) in `lane` (0 = leftmost).

        placed: it only goes where it is put
        """
        kind = f"{'placed' if placed else 'free'}-{length:.2f}-{width:.2f}-{lane == 0}"
        if kind not in self._sumo.vehicletype.getIDList():
            self._sumo.vehicletype.copy("DEFAULT_VEHTYPE", kind)
            reserved = placed or lane == 0
            self._sumo.vehicletype.setVehicleClass(kind, CONTROLLED_CLASS if reserved else BACKGROUND_CLASS)
            self._sumo.vehicletype.setLength(kind, length)
            self._sumo.vehicletype.setWidth(kind, width)
        edge, index, position = self._where(lane, station + 0.5 * length)
        route = route_from(self._sumo, self._corridor, edge)
        self._sumo.vehicle.add(name, route, typeID=kind, departLane=str(index), departPos=f"{position:.2f}",
                            departSpeed=f"{speed:.3f}")  # fmt: skip
        self._length[name] = length
        if placed:
            self._sumo.vehicle.setSpeedMode(name, UNCHECKED)
            self._sumo.vehicle.setLaneChangeMode(name, UNCHECKED)

    def put(self, name: str, lane: int, station: float, speed: float) -> None:
        """Move a placed vehicle for the coming step."""
        edge, index, position = self._where(lane, station + 0.5 * self._length[name])
        self._sumo.vehicle.moveTo(name, f"{edge}_{index}", position)
        self._sumo.vehicle.setSpeed(name, max(speed, 0.0))

    def remove(self, name: str) -> None:
        if name in self.names():
            self._sumo.vehicle.remove(name)

    def names(self) -> set[str]:
        """Vehicles that are on the road."""
        return set(self._sumo.vehicle.getIDList())

    def step(self) -> None:
        self._sumo.simulationStep()
        self.seen += self._sumo.simulation.getDepartedNumber()

    def between(self, first_m: float, last_m: float) -> list[str]:
        """The corridor's edges that lie between two stations."""
        lane = self._corridor.edge_index[0]
        stations = np.arange(len(lane)) * self._corridor.ds_m
        found = []
        for number, edge in enumerate(self._corridor.edges):
            at = stations[lane == number]
            if len(at) and first_m <= at[0] and at[-1] <= last_m:
                found.append(edge)
        return found

    def length_of(self, edges: Sequence[str]) -> float:
        """Length of edges along the road, m."""
        return float(sum(self._sumo.lane.getLength(f"{edge}_0") for edge in edges))

    def count(self, edges: Sequence[str]) -> tuple[int, float]:
        """How many vehicles SUMO sees on edges, and the sum of their speeds (m/s)."""
        number = [self._sumo.edge.getLastStepVehicleNumber(edge) for edge in edges]
        speed = [self._sumo.edge.getLastStepMeanSpeed(edge) for edge in edges]
        return sum(number), float(sum(n * v for n, v in zip(number, speed, strict=True)))

    def limit(self, edges: Sequence[str], lane: int, speed: float) -> None:
        """Speed limit of a lane (0 = leftmost) on edges."""
        for edge in edges:
            index = self._sumo.edge.getLaneNumber(edge) - 1 - lane
            if index >= 0:
                self._sumo.lane.setMaxSpeed(f"{edge}_{index}", max(speed, 0.1))

    def read(self, name: str) -> tuple[int, float, float, float]:
        """Lane, station of the centre (m), speed (m/s) and acceleration (m/s^2) of a vehicle on the road."""
        x, y = self._sumo.vehicle.getPosition(name)
        station, _ = self._corridor.project(np.array([x]), np.array([y]))
        k = int(self._corridor.nearest_station(float(station[0])))
        edge, index = self._sumo.vehicle.getRoadID(name), self._sumo.vehicle.getLaneIndex(name)
        lanes = self._corridor.lane_left.shape[0]
        named = [lane for lane in range(lanes) if self._hints[k * lanes + lane] == (edge, index)]
        if named:
            lane = named[0]
        else:  # just before or after an edge's end
            lane = int(np.argmax(self._corridor.sumo_lane[:, k] == index))
        return (
            lane,
            float(station[0]) - 0.5 * self._length[name],
            self._sumo.vehicle.getSpeed(name),
            self._sumo.vehicle.getAcceleration(name),
        )

    def _where(self, lane: int, station: float) -> tuple[str, int, float]:
        """Edge, lane index and position (m) of a front bumper at `station`."""
        lanes, stations = self._corridor.sumo_lane.shape
        k = min(max(round(station / self._corridor.ds_m), 0), stations - 1)
        edge, index = self._hints[k * lanes + lane]
        if (edge, index) not in self._extent:
            self._extent[edge, index] = lane_extent(self._sumo, self._corridor, edge, index)
        first, length = self._extent[edge, index]
        return edge, index, min(max(station - first, 0.1), length - 0.1)
