"""Where the vehicles of a scenario stand when a rollout begins, for pictures and meshes without a simulation."""

import numpy as np

import ce
from policies.drivers import load_drivers
from service.world.camera.poses import COLUMNS, HEADING_RAD, LENGTH_M, WIDTH_M, X_M, Y_M
from service.world.scenario.base import base_distribution, unpack
from service.world.scenario.schema import Scenario
from sumo_nets.corridor import Corridor


def first_draw(base: ce.Product, seed: int) -> np.ndarray:
    """The draw x (d,) of the rollout that `tailroad rollout --seed` runs."""
    return ce.draw(base, seed, "estimate", 0, 0, 1)[0][0]


def start_poses(scenario: Scenario, corridor: Corridor, seed: int) -> np.ndarray:
    """Poses (n, 6) at the start of the rollout that `tailroad rollout --seed` runs."""
    base = base_distribution(scenario, load_drivers(scenario.drivers.weights))
    starts, _ = unpack(scenario, first_draw(base, seed))
    poses = np.zeros((len(starts), COLUMNS))
    for row, start in zip(poses, starts, strict=True):
        offset = corridor.lane_center(start.lane, start.station_m) + start.lane_offset_m
        px, py, heading = corridor.to_xy(start.station_m, offset)
        row[[X_M, Y_M, HEADING_RAD]] = float(px), float(py), float(heading) + start.lane_heading_rad
        row[[LENGTH_M, WIDTH_M]] = start.length_m, start.width_m
    return poses
