"""SUMO beside the kernels: the only file that imports libsumo.

SUMO holds the network, the registry of vehicles, lanes and the clock; the controlled vehicles are placed each step by
TraCI's `moveToXY` where the kernels say they are (keepRoute=2: exactly there, also off the road), then SUMO steps.
Background vehicles are SUMO's own, and are read back each step.

libsumo holds one simulation a process; a second `SumoSession` in a process is refused while the first is open.
"""

import contextlib
import math
import os
import shutil
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

# SUMO looks for its data folder; ours never needs it, and an unset variable costs a warning.
os.environ.setdefault("SUMO_HOME", str(Path(__file__).parent))

import libsumo
import numpy as np
import traci
from libsumo import constants as tc

from policies.exactmath import sincos
from service import agents as A
from service.errors import SimulationError
from sumo_nets.corridor import Corridor

EXACT = 2  # keepRoute of moveToXY: place the vehicle exactly, whatever the lane
MATCH_WITHIN_M = 10.0  # lanes further from a vehicle than this are not looked at when it is placed
UNCHECKED = 0  # speed and lane-change modes: SUMO adds no rules of its own to controlled vehicles
CONTROLLED_CLASS = "hov"  # may use every lane
ROUTE = "corridor"
GUI_VIEW = "View #0"
GUI_ZOOM = 8000.0  # percent
RARELY_S = 100.0  # SUMO plans a controlled vehicle's own motion this seldom: nobody uses that plan

FOLLOWER_TYPE = "follower"
FOLLOWS_WITHIN_M = 150.0  # how far ahead a car-following model looks

SUBSCRIBED = (tc.VAR_POSITION, tc.VAR_ANGLE, tc.VAR_SPEED, tc.VAR_LENGTH, tc.VAR_WIDTH)
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


class SumoSession:
    """A SUMO simulation on a corridor for one process; use as a context manager."""

    _open: "SumoSession | None" = None

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
        """names, sizes: each controlled vehicle's id and (length, width) in m. fcd: floating-car data file. gui: the
        vehicle that SUMO's own GUI follows, in a window and at real time; SimulationError where there is none.
        follower: a controlled vehicle and the car-following model that `follow_speed` asks for it."""
        if SumoSession._open is not None:
            raise SimulationError("this process already runs a SUMO simulation; close it first")
        self._corridor = corridor
        self._names = list(names)
        self._types = [f"controlled-{name}" for name in names]
        self._sizes = list(sizes)
        self._background = background
        self._files: list[str] = []
        self._options = [
            "sumo", "--net-file", corridor.net_path, "--step-length", str(step_s),
            "--no-step-log", "true", "--no-warnings", "true", "--duration-log.disable", "true",
            "--collision.action", "none", "--time-to-teleport", "-1",
        ]  # fmt: skip
        if fcd is not None:
            self._options += ["--fcd-output", str(fcd)]
        self._follower = follower
        if follower is not None:
            self._options += ["--additional-files", self._type_file(follower[1])]
        self._followed = gui
        self._moves: list[tuple[int, str]] = []
        self._hints = _lane_hints(corridor)
        self._sumo: Any = libsumo
        try:
            if gui is None:
                libsumo.start(self._options)
            else:
                self._sumo = _start_gui(self._options)
        except (libsumo.TraCIException, libsumo.FatalTraCIError) as error:
            raise SimulationError(f"SUMO cannot load {corridor.net_path}: {error}") from error
        SumoSession._open = self
        self._prepare()

    def __enter__(self) -> "SumoSession":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        if SumoSession._open is self:
            SumoSession._open = None
            self._sumo.close()
            for name in self._files:
                with contextlib.suppress(OSError):
                    os.unlink(name)

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
            self._sumo.vehicletype.copy("DEFAULT_VEHTYPE", BACKGROUND_TYPE)
            self._sumo.vehicletype.setVehicleClass(BACKGROUND_TYPE, BACKGROUND_CLASS)
            self._sumo.vehicletype.setMaxSpeed(BACKGROUND_TYPE, self._background.speed_mps)

    def begin(self, poses: np.ndarray, seed: int) -> None:
        """Start a rollout with all controlled vehicles at `poses` (see service.sim.step.advance_all).

        With background traffic SUMO is loaded anew with the rollout's seed; without it nothing in SUMO is random
        and only the vehicles are replaced.
        """
        if self._background is not None:
            self._sumo.load([*self._options[1:], "--seed", str(seed % 2**31)])
            self._prepare()
        else:
            for _, name in self._moves:
                with contextlib.suppress(
                    libsumo.TraCIException, traci.TraCIException
                ):  # SUMO let it arrive by itself
                    self._sumo.vehicle.remove(name)
        self._moves = []
        for row, (name, kind) in enumerate(zip(self._names, self._types, strict=True)):
            self._sumo.vehicle.add(name, ROUTE, typeID=kind, departSpeed="0")
            self._sumo.vehicle.setSpeedMode(name, UNCHECKED)
            self._sumo.vehicle.setLaneChangeMode(name, UNCHECKED)
            self._moves.append((row, name))
        if self._background is not None:
            self._populate(np.random.Generator(np.random.Philox(key=seed)))
        self.step(poses)
        if self._followed is not None:
            self._sumo.gui.trackVehicle(GUI_VIEW, self._followed)
            self._sumo.gui.setZoom(GUI_VIEW, GUI_ZOOM)

    def step(self, poses: np.ndarray) -> None:
        """Place the controlled vehicles at `poses` (vehicles, 4) and advance SUMO by one step."""
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
        self._sumo.simulationStep()

    def follow_speed(self, vehicle: str, speed_mps: float) -> tuple[float, float, float]:
        """The speed (m/s) that the vehicle's car-following model allows it in the next step behind the vehicle ahead in
        its lane, infinite where there is none; and the most it may accelerate and brake (m/s^2, both positive)."""
        sumo = self._sumo.vehicle
        limits = sumo.getAccel(vehicle), sumo.getEmergencyDecel(vehicle)
        ahead = sumo.getLeader(vehicle, FOLLOWS_WITHIN_M)
        if not ahead or not ahead[0]:
            return math.inf, *limits
        leader, gap_m = ahead
        speed = sumo.getFollowSpeed(
            vehicle, speed_mps, max(gap_m, 0.0), sumo.getSpeed(leader), sumo.getDecel(leader), leader
        )
        return float(speed), *limits

    def _type_file(self, model: str) -> str:
        """A file that tells SUMO of a vehicle type with this car-following model; SUMO has no call for it."""
        with tempfile.NamedTemporaryFile("w", suffix=".add.xml", delete=False) as file:
            file.write(f'<additional><vType id="{FOLLOWER_TYPE}" carFollowModel="{model}"/></additional>')
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
        controlled = set(self._names)
        for name in self._sumo.simulation.getDepartedIDList():
            if name not in controlled:
                self._sumo.vehicle.subscribe(name, SUBSCRIBED)
        seen = self._sumo.vehicle.getAllSubscriptionResults()
        row = first
        for name in sorted(seen):
            if row == agents.shape[0]:
                raise SimulationError(
                    f"more than {agents.shape[0] - first} background vehicles; lower the density"
                )
            values = seen[name]
            heading = (90.0 - values[tc.VAR_ANGLE]) * (math.pi / 180.0)
            sine, cosine = sincos(heading)
            length = values[tc.VAR_LENGTH]
            x, y = values[tc.VAR_POSITION]
            agents[row, A.X_M] = x - 0.5 * length * cosine
            agents[row, A.Y_M] = y - 0.5 * length * sine
            agents[row, A.HEADING_RAD] = heading
            agents[row, A.SPEED_MPS] = values[tc.VAR_SPEED]
            agents[row, A.LENGTH_M] = length
            agents[row, A.WIDTH_M] = values[tc.VAR_WIDTH]
            agents[row, A.ACTIVE] = 1.0
            row += 1
        return row

    def _populate(self, generator: np.random.Generator) -> None:
        """Background vehicles along the road, spaced exponentially, and their followers from its start."""
        traffic = self._background
        assert traffic is not None
        corridor = self._corridor
        free = corridor.lane_left.shape[0]
        for lane in range(free):
            exists = np.flatnonzero(corridor.sumo_lane[lane] >= 0)
            if exists.size < corridor.sumo_lane.shape[1]:
                continue  # ramps and auxiliary lanes stay empty
            allowed = self._sumo.lane.getAllowed(_lane_id(corridor, lane, 0))  # empty: everybody
            if allowed and BACKGROUND_CLASS not in allowed:
                continue  # a restricted lane (HOV)
            mean_gap = max(1000.0 / traffic.density_veh_per_km_lane - MINIMUM_SPACING_M, 1.0)
            at = corridor.length_m - 10.0
            number = 0
            while True:
                at -= MINIMUM_SPACING_M + generator.exponential(mean_gap)
                if traffic.clear_from_m - CLEAR_BEFORE_M < at < traffic.clear_to_m + CLEAR_AFTER_M:
                    continue
                if at < -traffic.horizon_s * traffic.speed_mps:
                    break
                self._add_background(f"background-{lane + 1}-{number}", lane, at)
                number += 1

    def _add_background(self, name: str, lane: int, station_m: float) -> None:
        """A background vehicle on the road, or one that enters it later if `station_m` lies before its start."""
        speed = self._background.speed_mps if self._background else 0.0
        edge, sumo_lane = self._corridor.sumo_position(lane, max(station_m, 0.0))
        if station_m < 10.0:
            depart = f"{(10.0 - station_m) / speed:.3f}"
            self._sumo.vehicle.add(name, ROUTE, typeID=BACKGROUND_TYPE, depart=depart, departLane=str(sumo_lane),
                                departPos="10", departSpeed="max")  # fmt: skip
            return
        position = self._sumo.simulation.convert2D(edge, 0.0, sumo_lane)
        start, _ = self._corridor.project(np.array([position[0]]), np.array([position[1]]))
        within = station_m - float(start[0])
        index = self._corridor.edges.index(edge)
        route = f"{ROUTE}-from-{index}"
        if route not in self._sumo.route.getIDList():
            self._sumo.route.add(route, list(self._corridor.edges[index:]))
        length = self._sumo.lane.getLength(f"{edge}_{sumo_lane}")
        if not 6.0 < within < length - 1.0:
            return  # too close to a junction to stand there
        self._sumo.vehicle.add(name, route, typeID=BACKGROUND_TYPE, departLane=str(sumo_lane),
                            departPos=f"{within:.2f}", departSpeed="max")  # fmt: skip


def _start_gui(options: list[str]) -> Any:
    """SUMO's GUI in a process of its own, stepped through TraCI at real time."""
    beside = Path(sys.executable).parent / "sumo-gui"
    program = shutil.which("sumo-gui") or (str(beside) if beside.exists() else None)
    if program is None:
        raise SimulationError(
            "there is no sumo-gui; install SUMO, or eclipse-sumo from the Python package index"
        )
    if not os.environ.get("DISPLAY") and not os.environ.get("WAYLAND_DISPLAY"):
        raise SimulationError(
            "SUMO's GUI needs a screen, and DISPLAY names none; use --video or --frames here"
        )
    step_ms = round(1000.0 * float(options[options.index("--step-length") + 1]))
    try:
        traci.start(
            [program, *options[1:], "--start", "--quit-on-end", "--delay", str(step_ms)], numRetries=60
        )
    except (traci.TraCIException, traci.FatalTraCIError, OSError) as error:
        raise SimulationError(f"SUMO's GUI does not start: {error}") from error
    return traci


def _lane_id(corridor: Corridor, lane: int, station: int) -> str:
    return f"{corridor.edges[corridor.edge_index[lane, station]]}_{corridor.sumo_lane[lane, station]}"


def _lane_hints(corridor: Corridor) -> list[tuple[str, int]]:
    """SUMO's (edge, lane) for each hint code (station * lanes + lane) of the kernels."""
    lanes, stations = corridor.sumo_lane.shape
    hints = []
    for k in range(stations):
        for lane in range(lanes):
            edge, index = corridor.edge_index[lane, k], corridor.sumo_lane[lane, k]
            hints.append((corridor.edges[edge], int(index)) if index >= 0 else ("", -1))
    return hints


class SumoTraffic:
    """Vehicles that SUMO's own driver (Krauss) drives among others that are put where they are told; a context manager.

    SUMO knows lanes and positions along them: a vehicle that is changing lanes is in the middle of one or the other.
    """

    def __init__(self, corridor: Corridor, step_s: float, seed: int, insert_anyhow: bool = True):
        """insert_anyhow: vehicles appear where they are added; otherwise when SUMO finds it safe."""
        if SumoSession._open is not None:
            raise SimulationError("this process already runs a SUMO simulation; close it first")
        self._corridor = corridor
        self._options = [
            "sumo", "--net-file", corridor.net_path, "--step-length", str(step_s), "--seed", str(seed % 2**31),
            "--no-step-log", "true", "--no-warnings", "true", "--duration-log.disable", "true",
            "--collision.action", "none", "--time-to-teleport", "-1",
        ]  # fmt: skip
        if insert_anyhow:
            self._options += ["--insertion-checks", "none"]
        self._hints = _lane_hints(corridor)
        self._extent: dict[
            tuple[str, int], tuple[float, float]
        ] = {}  # an edge's lane: first station, length (m)
        self._length: dict[str, float] = {}
        self.seen = 0  # vehicles that have entered the road
        libsumo.start(self._options)
        SumoSession._open = self  # type: ignore[assignment]

    def __enter__(self) -> "SumoTraffic":
        return self

    def __exit__(self, *_: object) -> None:
        SumoSession._open = None
        libsumo.close()

    def clear(self) -> None:
        """Take all vehicles out."""
        for name in libsumo.vehicle.getIDList():
            libsumo.vehicle.remove(name)
        libsumo.simulationStep()
        self._length = {}

    def add(
        self, name: str, length: float, width: float, lane: int, station: float, speed: float, told: bool
    ) -> None:
        """A vehicle whose centre is at `station` (m) in `lane` (0 = leftmost); told: it only goes where it is put."""
        kind = f"{'told' if told else 'free'}-{length:.2f}-{width:.2f}-{lane == 0}"
        if kind not in libsumo.vehicletype.getIDList():
            libsumo.vehicletype.copy("DEFAULT_VEHTYPE", kind)
            reserved = told or lane == 0
            libsumo.vehicletype.setVehicleClass(kind, CONTROLLED_CLASS if reserved else BACKGROUND_CLASS)
            libsumo.vehicletype.setLength(kind, length)
            libsumo.vehicletype.setWidth(kind, width)
        edge, index, position = self._where(lane, station + 0.5 * length)
        first = self._corridor.edges.index(edge)
        route = f"{ROUTE}-from-{first}"
        if route not in libsumo.route.getIDList():
            libsumo.route.add(route, list(self._corridor.edges[first:]))
        libsumo.vehicle.add(name, route, typeID=kind, departLane=str(index), departPos=f"{position:.2f}",
                            departSpeed=f"{speed:.3f}")  # fmt: skip
        self._length[name] = length
        if told:
            libsumo.vehicle.setSpeedMode(name, UNCHECKED)
            libsumo.vehicle.setLaneChangeMode(name, UNCHECKED)

    def put(self, name: str, lane: int, station: float, speed: float) -> None:
        """Place a told vehicle for the coming step."""
        edge, index, position = self._where(lane, station + 0.5 * self._length[name])
        libsumo.vehicle.moveTo(name, f"{edge}_{index}", position)
        libsumo.vehicle.setSpeed(name, max(speed, 0.0))

    def remove(self, name: str) -> None:
        if name in self.names():
            libsumo.vehicle.remove(name)

    def names(self) -> set[str]:
        """Vehicles that are on the road."""
        return set(libsumo.vehicle.getIDList())

    def step(self) -> None:
        libsumo.simulationStep()
        self.seen += libsumo.simulation.getDepartedNumber()

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
        return float(sum(libsumo.lane.getLength(f"{edge}_0") for edge in edges))

    def count(self, edges: Sequence[str]) -> tuple[int, float]:
        """How many vehicles SUMO sees on edges, and the sum of their speeds (m/s)."""
        number = [libsumo.edge.getLastStepVehicleNumber(edge) for edge in edges]
        speed = [libsumo.edge.getLastStepMeanSpeed(edge) for edge in edges]
        return sum(number), float(sum(n * v for n, v in zip(number, speed, strict=True)))

    def limit(self, edges: Sequence[str], lane: int, speed: float) -> None:
        """Speed limit of a lane (0 = leftmost) on edges."""
        for edge in edges:
            index = libsumo.edge.getLaneNumber(edge) - 1 - lane
            if index >= 0:
                libsumo.lane.setMaxSpeed(f"{edge}_{index}", max(speed, 0.1))

    def read(self, name: str) -> tuple[int, float, float, float]:
        """Lane, station of the centre (m), speed (m/s) and acceleration (m/s^2) of a vehicle on the road."""
        x, y = libsumo.vehicle.getPosition(name)
        station, _ = self._corridor.project(np.array([x]), np.array([y]))
        k = int(self._corridor.nearest_station(float(station[0])))
        edge, index = libsumo.vehicle.getRoadID(name), libsumo.vehicle.getLaneIndex(name)
        lanes = self._corridor.lane_left.shape[0]
        named = [lane for lane in range(lanes) if self._hints[k * lanes + lane] == (edge, index)]
        if named:
            lane = named[0]
        else:  # just before or after an edge's end
            lane = int(np.argmax(self._corridor.sumo_lane[:, k] == index))
        return (
            lane,
            float(station[0]) - 0.5 * self._length[name],
            libsumo.vehicle.getSpeed(name),
            libsumo.vehicle.getAcceleration(name),
        )

    def _where(self, lane: int, station: float) -> tuple[str, int, float]:
        """Edge, lane index and position (m) of a front bumper at `station`."""
        lanes, stations = self._corridor.sumo_lane.shape
        k = min(max(round(station / self._corridor.ds_m), 0), stations - 1)
        edge, index = self._hints[k * lanes + lane]
        if (edge, index) not in self._extent:
            x, y = libsumo.simulation.convert2D(edge, 0.0, index)
            start, _ = self._corridor.project(np.array([x]), np.array([y]))
            self._extent[edge, index] = float(start[0]), libsumo.lane.getLength(f"{edge}_{index}")
        first, length = self._extent[edge, index]
        return edge, index, min(max(station - first, 0.1), length - 0.1)
