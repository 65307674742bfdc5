"""A contact sheet: the same road and vehicles in several weathers."""

import cv2
import msgspec
import numpy as np

from service.world.camera.poses import ACCELERATION_MPS2, COLUMNS, HEADING_RAD, LENGTH_M, WIDTH_M, X_M, Y_M
from service.world.camera.render import Camera
from service.world.camera.scene import build_scene
from service.world.camera.weather import Weather
from service.world.scenario.schema import Scenario
from sumo_nets.corridor import Corridor

WIDTH_PX, HEIGHT_PX = 480, 270
COLUMNS_OF_SHEET = 3
WEATHERS: dict[str, Weather] = {
    "clear afternoon": Weather(48.0, 215.0, 0.15),
    "low sun ahead": Weather(7.0, 338.0, 0.2),
    "dusk": Weather(-2.5, 300.0, 0.25),
    "night": Weather(-16.0, 300.0, 0.2),
    "rain, 8 mm/h": Weather(30.0, 200.0, 0.4, 8.0),
    "rain at night": Weather(-14.0, 200.0, 0.4, 8.0),
    "fog, 150 m": Weather(40.0, 200.0, 26.0),
    "fog at dawn, 330 m": Weather(3.0, 90.0, 12.0),
    "fog at night, 130 m": Weather(-14.0, 90.0, 30.0),
}
# station ahead of the ego (m), lane, length (m), width (m), acceleration (m/s^2)
TRAFFIC = (
    (0.0, 2, 4.5, 1.8, 0.0),
    (16.0, 3, 6.2, 2.1, 0.0),
    (26.0, 1, 4.5, 1.8, 0.0),
    (38.0, 3, 4.5, 1.8, -2.0),
    (46.0, 2, 4.6, 1.8, 0.0),
    (62.0, 1, 14.0, 2.5, 0.0),
    (80.0, 4, 4.5, 1.8, 0.0),
    (95.0, 0, 4.5, 1.8, 0.0),
)


def traffic(corridor: Corridor, station: float) -> np.ndarray:
    """Poses (n, 6) of vehicles round `station`, the ego first; lanes that the road does not have are left out."""
    rows = []
    for ahead, lane, length, width, acceleration in TRAFFIC:
        at = min(station + ahead, corridor.length_m)
        offset = corridor.lane_center(min(lane, corridor.lane_count - 1), at)
        if np.isfinite(offset):
            x, y, heading = corridor.to_xy(at, offset)
            row = np.zeros(COLUMNS)
            row[[X_M, Y_M, HEADING_RAD]] = float(x), float(y), float(heading)
            row[[LENGTH_M, WIDTH_M, ACCELERATION_MPS2]] = length, width, acceleration
            rows.append(row)
    return np.array(rows)


def contact_sheet(
    scenario: Scenario, corridor: Corridor, seed: int, station: float, own: bool = False
) -> np.ndarray:
    """One picture (h, w, 3) uint8 RGB of the road in all WEATHERS; `own`: by the scenario's camera as it is."""
    scene, poses = build_scene(corridor), traffic(corridor, station)
    spec = scenario.camera
    if not own:
        spec = msgspec.structs.replace(spec, width_px=WIDTH_PX, height_px=HEIGHT_PX, pitch_deg=-3.0)
    camera = Camera(spec)
    tiles = []
    for name, weather in WEATHERS.items():
        tile = camera.render(scene, poses, 0, weather, seed)
        if own:
            tile = cv2.resize(tile, None, fx=2.0, fy=2.0, interpolation=cv2.INTER_NEAREST)
        (w, h), _ = cv2.getTextSize(name, cv2.FONT_HERSHEY_SIMPLEX, 0.45, 1)
        cv2.rectangle(tile, (0, 0), (w + 12, h + 12), (20, 20, 20), -1)
        cv2.putText(tile, name, (6, h + 5), cv2.FONT_HERSHEY_SIMPLEX, 0.45, (240, 240, 240), 1, cv2.LINE_AA)
        tiles.append(np.pad(tile, ((0, 4), (0, 4), (0, 0)), constant_values=255))
    rows = [np.hstack(tiles[i : i + COLUMNS_OF_SHEET]) for i in range(0, len(tiles), COLUMNS_OF_SHEET)]
    return np.vstack(rows)[:-4, :-4]
