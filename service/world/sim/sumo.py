"""SUMO beside the kernels.

SUMO holds the network, the registry of vehicles, lanes and the clock; the controlled vehicles are placed each step by
TraCI's `moveToXY` where the kernels say they are (keepRoute=2: exactly there, also off the road), then SUMO steps.
Background vehicles are SUMO's own, and are read back each step (`service.world.sim.sumo_background`).
"""

import contextlib
import math
import os
import tempfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from service.errors import SimulationError
from service.world.sim import sumo_background as background_vehicles
from service.world.sim.drawn_lengths import network_as_drawn, stretch
from service.world.sim.fcd import FcdWriter
from service.world.sim.sumo_background import ROUTE, BackgroundTraffic
from service.world.sim.sumo_library import REFUSALS, close_simulation, open_simulation, options_for
from sumo_nets.corridor import Corridor

EXACT = 2  # keepRoute of moveToXY: place the vehicle exactly, whatever the lane
MATCH_WITHIN_M = 10.0  # lanes further from a vehicle than this are not looked at when it is placed
UNCHECKED = 0  # speed and lane-change modes: SUMO adds no rules of its own to controlled vehicles
CONTROLLED_CLASS = "ignoring"  # SUMO's class for which no lane's permissions count
GUI_VIEW = "View #0"
GUI_ZOOM = 8000.0  # percent
RARELY_S = 100.0  # SUMO plans a controlled vehicle's own motion this seldom: nobody uses that plan

FOLLOWER_TYPE = "follower"
FOLLOWS_WITHIN_M = 150.0  # how far ahead a car-following model looks


class SumoSession:
    """A SUMO simulation on a corridor; use as a context manager. A process has one at a time: a second is refused."""

    def __init__(
        self,
        corridor: Corridor,
        names: Sequence[str],
        sizes: Sequence[tuple[float, float]],
        step_s: float,
        background: BackgroundTraffic | None = None,
        fcd: Path | None = None,
        gui: str | None = None,
        follower: tuple[str, str] | None = None,
    ):
        """Start SUMO with the corridor's network.

        names, sizes: each controlled vehicle's id and (length, width) in m
        fcd: floating-car data file
        gui: the vehicle that SUMO's own GUI follows, in a window and at real time; SimulationError where there is
            none
        follower: a controlled vehicle and the car-following model that `follow_speed` asks for it
        """
        self._corridor = corridor
        self._names = list(names)
        self._types = [f"controlled-{name}" for name in names]
        self._sizes = list(sizes)
        self._background = background
        self._files: list[str] = []
        network, copy = network_as_drawn(corridor)
        if copy is not None:
            self._files.append(str(copy))
        self._options = options_for(network, step_s)
        self._fcd = None if fcd is None else FcdWriter(fcd, step_s)
        self._follower = follower
        if follower is not None:
            self._options += ["--additional-files", self._type_file(follower[1])]
        self._followed = gui
        # SUMO's own idea of a placed vehicle's speed is wrong: it is told where somebody may ask for it
        self.tells_speeds = bool(background or follower or fcd or gui)
        self._drawn: dict[str, float] = {}  # metres as drawn in one of SUMO's, by lane
        self._moves: list[tuple[int, str]] = []
        self._hints = lane_hints(corridor)
        try:
            self._sumo = open_simulation(self, self._options, gui is not None)
        except SimulationError:
            self._remove_files()
            raise
        self._prepare()

    def __enter__(self) -> "SumoSession":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        if self._fcd is not None:
            self._fcd.close()
        close_simulation(self)
        self._remove_files()

    def _remove_files(self) -> None:
        for name in self._files:
            with contextlib.suppress(OSError):
                os.unlink(name)
        self._files = []

    def _prepare(self) -> None:
        """Route and vehicle types, which a load forgets."""
        self._sumo.route.add(ROUTE, list(self._corridor.edges))
        for name, (length, width) in zip(self._types, self._sizes, strict=True):
            follows = self._follower is not None and name == f"controlled-{self._follower[0]}"
            self._sumo.vehicletype.copy(FOLLOWER_TYPE if follows else "DEFAULT_VEHTYPE", name)
            self._sumo.vehicletype.setVehicleClass(name, CONTROLLED_CLASS)
            self._sumo.vehicletype.setLength(name, length)
            self._sumo.vehicletype.setWidth(name, width)
            if not follows:
                self._sumo.vehicletype.setActionStepLength(name, RARELY_S)
        if self._background is not None:
            background_vehicles.define(self._sumo, self._background)

    def begin(self, poses: np.ndarray, seed: int, speeds: np.ndarray | None = None) -> None:
        """Start a rollout with all controlled vehicles at `poses` (see service.world.sim.step.advance_all).

        Where SUMO drives, background traffic or an ego, it is loaded anew with the rollout's seed: what is random in it
        would outlive the rollout. Otherwise nothing in SUMO is random and only the vehicles are replaced.
        """
        if self._background is not None or self._follower is not None:
            self._sumo.load([*self._options, "--seed", str(seed % 2**31)])
            self._prepare()
        else:
            for _, name in self._moves:
                with contextlib.suppress(*REFUSALS):  # SUMO let it arrive by itself
                    self._sumo.vehicle.remove(name)
        self._moves = []
        for row, (name, kind) in enumerate(zip(self._names, self._types, strict=True)):
            self._sumo.vehicle.add(name, ROUTE, typeID=kind, departSpeed="0")
            self._sumo.vehicle.setSpeedMode(name, UNCHECKED)
            self._sumo.vehicle.setLaneChangeMode(name, UNCHECKED)
            self._moves.append((row, name))
        if self._background is not None:
            generator = np.random.Generator(np.random.Philox(key=seed))
            background_vehicles.populate(self._sumo, self._corridor, self._background, generator)
        if self._fcd is not None:
            self._fcd.begin()
        self.step(poses, speeds)
        if self._followed is not None:
            self._sumo.gui.trackVehicle(GUI_VIEW, self._followed)
            self._sumo.gui.setZoom(GUI_VIEW, GUI_ZOOM)

    def step(self, poses: np.ndarray, speeds: np.ndarray | None = None) -> None:
        """Place the controlled vehicles at `poses` (vehicles, 4) and advance SUMO by one step.

        speeds: (vehicles,) m/s, where SUMO is to have them
        """
        move = self._sumo.vehicle.moveToXY
        hints = self._hints
        rows = poses.tolist()
        gone = False
        for row, name in self._moves:
            x, y, angle, hint = rows[row]
            if hint < 0.0:
                gone = True
                continue
            edge, lane = hints[int(hint)]
            move(name, edge, lane, x, y, angle, EXACT, MATCH_WITHIN_M)
        if gone:
            self._remove_gone(rows)
        if speeds is None:
            self._sumo.simulationStep()
            return
        told = [(name, max(float(speeds[row]), 0.0)) for row, name in self._moves]
        for name, speed in told:
            self._sumo.vehicle.setSpeed(name, speed)
        self._sumo.simulationStep()
        known = set(self._sumo.vehicle.getIDList())
        for name, speed in told:
            if name in known:
                self._sumo.vehicle.setPreviousSpeed(name, speed)
        if self._fcd is not None:
            placed = {name: (rows[row][0], rows[row][1], float(speeds[row])) for row, name in self._moves}
            self._fcd.see(self._sumo, placed)

    def follow_speed(self, vehicle: str, speed_mps: float) -> tuple[float, float, float]:
        """The speed (m/s) that the vehicle's car-following model allows it in the next step behind the vehicle ahead in
        its lane, infinite where there is none; and the most it may accelerate and brake (m/s^2, both positive)."""
        sumo = self._sumo.vehicle
        limits = sumo.getAccel(vehicle), sumo.getEmergencyDecel(vehicle)
        ahead = sumo.getLeader(vehicle, FOLLOWS_WITHIN_M)
        if not ahead or not ahead[0]:
            return math.inf, *limits
        leader, gap_m = ahead
        room_m = sumo.getMinGap(vehicle)  # which SUMO has taken off the gap
        gap_m = (gap_m + room_m) * self._stretch(sumo.getLaneID(vehicle)) - room_m
        speed = sumo.getFollowSpeed(
            vehicle, speed_mps, max(gap_m, 0.0), sumo.getSpeed(leader), sumo.getDecel(leader), leader
        )
        return float(speed), *limits

    def _stretch(self, lane_id: str) -> float:
        if lane_id not in self._drawn:
            self._drawn[lane_id] = stretch(self._sumo, lane_id)
        return self._drawn[lane_id]

    def _type_file(self, model: str) -> str:
        """A file that tells SUMO of a vehicle type with this car-following model; SUMO has no call for it."""
        with tempfile.NamedTemporaryFile("w", suffix=".add.xml", delete=False) as file:
            file.write(
                f'<additional><vType id="{FOLLOWER_TYPE}" carFollowModel="{model}" '
                'speedDev="0" speedFactor="1"/></additional>'
            )
        self._files.append(file.name)
        return file.name

    def _remove_gone(self, rows: list[list[float]]) -> None:
        """Take vehicles that have left the world out of SUMO; SUMO may have let them arrive already."""
        known = set(self._sumo.vehicle.getIDList())
        for row, name in self._moves:
            if rows[row][3] < 0.0 and name in known:
                self._sumo.vehicle.remove(name)
        self._moves = [(row, name) for row, name in self._moves if rows[row][3] >= 0.0]

    def read_background(self, agents: np.ndarray, first: int) -> int:
        """Write the background vehicles into `agents` from row `first`; return the number of rows in use."""
        return background_vehicles.read(self._sumo, set(self._names), agents, first, self._stretch)


def lane_hints(corridor: Corridor) -> list[tuple[str, int]]:
    """SUMO's (edge, lane) for each hint code (station * lanes + lane) of the kernels."""
    lanes, stations = corridor.sumo_lane.shape
    hints = []
    for k in range(stations):
        for lane in range(lanes):
            edge, index = corridor.edge_index[lane, k], corridor.sumo_lane[lane, k]
            hints.append((corridor.edges[edge], int(index)) if index >= 0 else ("", -1))
    return hints
