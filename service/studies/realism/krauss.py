"""SUMO's own driver (Krauss with its lane-change model LC2013, default parameters) in recorded scenes, in SUMO itself.

The scene's lanes are laid over those of the I-80 network, leftmost on leftmost; SUMO needs lanes and positions along
them, not the road's shape. Vehicles that the model does not drive are put where they were recorded, each step.
"""

import numpy as np

from policies.data.scenes import Scene
from policies.realism.driven import Driven, driven_scene
from service.studies.realism.sumo_traffic import SumoTraffic
from sumo_nets.corridor import Corridor

STATION_M = 836.0  # where the scene's first metre lies: from here on the network has the ramp's lane, too
END_M = 30.0


class Krauss:
    """Drives columns of scenes by SUMO; one session a process."""

    def __init__(self, corridor: Corridor, seed: int):
        self._corridor = corridor
        self._traffic = SumoTraffic(corridor, 0.1, seed)
        self._runs = 0

    def __enter__(self) -> "Krauss":
        return self

    def __exit__(self, *_: object) -> None:
        self._traffic.__exit__()

    def drive_scene(self, scene: Scene, first: int, steps: int, who: np.ndarray) -> Driven:
        """Columns `who` driven by SUMO from row `first` on for `steps`."""
        traffic = self._traffic
        traffic.clear()
        self._runs += 1
        rows = slice(first, first + steps + 1)
        lanes, stations, shift = self._laid_out(scene, rows)
        speeds = np.nan_to_num(scene.speed[rows]).tolist()
        present = scene.present[rows].tolist()
        columns = np.flatnonzero(scene.present[rows].any(axis=0)).tolist()
        free = set(who.tolist())
        names = {v: f"{self._runs}-{v}" for v in columns}
        shape = (steps + 1, len(who))
        station, speed, accel, lane = np.zeros(shape), np.zeros(shape), np.zeros(shape), np.zeros(shape)
        for t in range(steps + 1):
            on_road = traffic.names()
            for v in columns:
                name = names[v]
                if present[t][v] and name not in on_road and (t == 0 or not present[t - 1][v]):
                    size = float(scene.length_m[v]), float(scene.width_m[v])
                    traffic.add(name, *size, lanes[t][v], stations[t][v], speeds[t][v], v not in free)
                elif v not in free and name in on_road:
                    if present[t][v]:
                        traffic.put(name, lanes[t][v], stations[t][v], speeds[min(t + 1, steps)][v])
                    else:
                        traffic.remove(name)
            for i, v in enumerate(who.tolist()):
                if t > 0 and names[v] in on_road:
                    lane[t, i], at, speed[t, i], accel[t, i] = traffic.read(names[v])
                    station[t, i] = at - shift
                elif t > 0:  # it has left the network
                    station[t, i] = station[t - 1, i] + 0.1 * speed[t - 1, i]
                    speed[t, i], lane[t, i] = speed[t - 1, i], lane[t - 1, i]
            traffic.step()
        offset = (0.5 * (len(scene.road.lane_left) - 1) - lane) * scene.road.lane_width_m
        station[0], speed[0], offset[0] = (
            getattr(scene, n)[first, who] for n in ("station", "speed", "lateral")
        )
        applied = np.roll(accel, -1, axis=0)  # SUMO tells the acceleration of the step before
        return driven_scene(scene, first, who, station, offset, speed, applied, np.zeros(shape))

    def _laid_out(self, scene: Scene, rows: slice) -> tuple[list[list[int]], list[list[float]], float]:
        """Lanes and stations (T, N) on the network of the rows of a scene, and how far stations were shifted."""
        road, longest = self._corridor, self._corridor.length_m
        shift = STATION_M if scene.road.length_m + STATION_M < longest else END_M
        station = np.clip(np.nan_to_num(scene.station[rows]) + shift, END_M, longest - END_M)
        lane = np.clip(scene.lane[rows], 0, road.lane_count - 1)
        absent = road.sumo_lane[lane, road.nearest_station(station + END_M)] < 0
        return np.where(absent, road.lane_count - 2, lane).tolist(), station.tolist(), shift
