"""What a rollout's start says of road, weather, light and traffic, in classes.

Headings follow ISO 34503 (taxonomy of an operational design domain): scenery, environmental conditions, dynamic
elements. All of it follows from the draw; no rollout is run for it.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from service.analysis.severity.masses import CLASSES, class_of
from service.world.camera.weather import KOSCHMIEDER, RAIN_PER_KM, Weather
from service.world.scenario.base import STARTS, WEATHER
from service.world.scenario.schema import Scenario
from sumo_nets.corridor import Corridor

AROUND_M = 100.0  # along the road to either side, where traffic is counted
KMH = 3.6


@dataclass(frozen=True)
class Attribute:
    """An attribute of the domain and its cells.

    name: by which files know it
    heading: where it stands in the taxonomy
    unit: of its values; "" for those that are names
    cells: their names, in order
    edges: values between them, ascending, one fewer than there are cells; a value at an edge lies above it
    values: of draws, (n, k) -> (n,), from scenario, road and the coordinates of x before the drivers' weights
    """

    name: str
    heading: str
    unit: str
    cells: tuple[str, ...]
    edges: tuple[float, ...]
    values: Callable[[Scenario, Corridor, np.ndarray], np.ndarray]

    def cell_of(self, scenario: Scenario, corridor: Corridor, x: np.ndarray) -> np.ndarray:
        """Number of the cell that each draw (n, k) lies in, (n,)."""
        found: np.ndarray = np.searchsorted(self.edges, self.values(scenario, corridor, x), side="right")
        return found


def _ego(scenario: Scenario, x: np.ndarray, column: int) -> np.ndarray:
    found: np.ndarray = x[:, STARTS * scenario.ego + column]
    return found


def _lanes(scenario: Scenario, corridor: Corridor, x: np.ndarray) -> np.ndarray:
    there = (~np.isnan(corridor.lane_left)).sum(axis=0)
    found: np.ndarray = there[corridor.nearest_station(_ego(scenario, x, 0))]
    return found


def _curvature(scenario: Scenario, corridor: Corridor, x: np.ndarray) -> np.ndarray:
    """The sharpest, 1/m, from where the ego starts to where its speed would take it."""
    station = _ego(scenario, x, 0)
    first = corridor.nearest_station(station)
    last = corridor.nearest_station(station + _ego(scenario, x, 3) * scenario.time.horizon_s)
    sharp = np.abs(corridor.ref_curvature)
    pairs, which = np.unique(np.column_stack([first, last]), axis=0, return_inverse=True)
    most = np.array([sharp[a : b + 1].max() for a, b in pairs.tolist()])
    found: np.ndarray = most[which.ravel()]
    return found


def _weather(key: str) -> Callable[[Scenario, np.ndarray], np.ndarray]:
    def values(scenario: Scenario, x: np.ndarray) -> np.ndarray:
        if scenario.weather is None:
            return np.full(len(x), float(getattr(Weather(), key)))
        found: np.ndarray = x[:, STARTS * len(scenario.vehicles) + WEATHER.index(key)]
        return found

    return values


_rain_mmph, _fog_per_km, _sun_deg = (
    _weather("rain_mmph"),
    _weather("fog_per_km"),
    _weather("sun_elevation_deg"),
)


def _rain(scenario: Scenario, corridor: Corridor, x: np.ndarray) -> np.ndarray:
    return _rain_mmph(scenario, x)


def _visibility(scenario: Scenario, corridor: Corridor, x: np.ndarray) -> np.ndarray:
    """Meteorological visibility in m, as of `service.world.camera.weather`."""
    extinction = np.maximum(_fog_per_km(scenario, x), 0.12) + RAIN_PER_KM * np.maximum(
        _rain_mmph(scenario, x), 0.0
    )
    return 1000.0 * KOSCHMIEDER / extinction


def _sun(scenario: Scenario, corridor: Corridor, x: np.ndarray) -> np.ndarray:
    return _sun_deg(scenario, x)


def _density(scenario: Scenario, corridor: Corridor, x: np.ndarray) -> np.ndarray:
    """Vehicles per km and lane within AROUND_M of the ego, itself included, and the background's."""
    stations = x[:, : STARTS * len(scenario.vehicles) : STARTS]
    near = np.abs(stations - _ego(scenario, x, 0)[:, None]) <= AROUND_M
    background = 0.0 if scenario.background is None else scenario.background.density_veh_per_km_lane
    found: np.ndarray = (
        near.sum(axis=1) / (2.0 * AROUND_M / 1000.0) / _lanes(scenario, corridor, x) + background
    )
    return found


def _own_speed(scenario: Scenario, corridor: Corridor, x: np.ndarray) -> np.ndarray:
    return KMH * _ego(scenario, x, 3)


def _traffic_speed(scenario: Scenario, corridor: Corridor, x: np.ndarray) -> np.ndarray:
    """Mean speed of the others; of the background where there is nobody else."""
    others = [i for i in range(len(scenario.vehicles)) if i != scenario.ego]
    if not others:
        alone = 0.0 if scenario.background is None else scenario.background.speed_mps
        return np.full(len(x), KMH * alone)
    found: np.ndarray = KMH * x[:, [STARTS * i + 3 for i in others]].mean(axis=1)
    return found


def _heaviest(scenario: Scenario, corridor: Corridor, x: np.ndarray) -> np.ndarray:
    """Rank in CLASSES of the largest class among the others."""
    names = [name for name, _, _ in CLASSES]
    others = [v for v in scenario.vehicles if v.role != "ego"]
    ranks = [names.index(class_of(scenario.of(v, "length_m"))[0]) for v in others]
    return np.full(len(x), float(max(ranks, default=names.index("car"))))


_SPEEDS = (30.0, 50.0, 70.0, 90.0, 110.0, 130.0)
_SPEED_CELLS = ("below 30", "30 to 50", "50 to 70", "70 to 90", "90 to 110", "110 to 130", "130 and above")
_VEHICLES = tuple(name for name, _, _ in CLASSES)
# Rain by the classes of intensity of weather services, fog by the WMO's limit of 1 km, traffic by the levels of service
# of the Highway Capacity Manual for freeways (7, 11, 16, 22, 28 passenger cars per km and lane).
ATTRIBUTES = (
    Attribute("lanes", "scenery: number of lanes", "", ("1", "2", "3", "4", "5", "6", "7 and more"),
              (1.5, 2.5, 3.5, 4.5, 5.5, 6.5), _lanes),
    Attribute("curvature", "scenery: horizontal alignment, radius", "m",
              ("above 2,000", "1,000 to 2,000", "500 to 1,000", "250 to 500", "below 250"),
              (1 / 2000, 1 / 1000, 1 / 500, 1 / 250), _curvature),
    Attribute("rain", "environment: rainfall", "mm/h",
              ("dry", "light, to 2.5", "moderate, to 10", "heavy, to 50", "violent"),
              (math.ulp(0.0), 2.5, 10.0, 50.0), _rain),
    Attribute("visibility", "environment: visibility", "m",
              ("below 200", "200 to 1,000", "1,000 to 5,000", "5,000 and above"), (200.0, 1000.0, 5000.0), _visibility),
    Attribute("illumination", "environment: illumination", "",
              ("night", "twilight", "low sun", "day"), (-6.0, 0.0, 10.0), _sun),
    Attribute("density", "dynamic: traffic density", "vehicles per km and lane",
              ("to 7 (A)", "7 to 11 (B)", "11 to 16 (C)", "16 to 22 (D)", "22 to 28 (E)", "above 28 (F)"),
              (7.0, 11.0, 16.0, 22.0, 28.0), _density),
    Attribute("ego-speed", "dynamic: speed of the ego at the start", "km/h", _SPEED_CELLS, _SPEEDS, _own_speed),
    Attribute("traffic-speed", "dynamic: mean speed of the others at the start", "km/h", _SPEED_CELLS, _SPEEDS,
              _traffic_speed),
    Attribute("vehicles", "dynamic: largest other vehicle", "", _VEHICLES,
              tuple(i + 0.5 for i in range(len(_VEHICLES) - 1)), _heaviest),
)  # fmt: skip
BY_NAME = {attribute.name: attribute for attribute in ATTRIBUTES}
