"""A road as the two tables that the kernels read."""

from typing import TYPE_CHECKING, NamedTuple, cast

import numpy as np

from policies.exactmath import sincos
from service.world.sim.projection import CLOSED, KEEPS_LEFT, KEEPS_RIGHT, RESERVED
from sumo_nets.corridor import Corridor, load_corridor

if TYPE_CHECKING:  # the scenes' module loads polars, which no worker needs
    from policies.data.scenes import SceneRoad

# Spline fits may differ in the last bits between processors; rounding to these grids (far below a millimetre over
# the whole road) makes the tables the same everywhere.
LENGTH_GRID_M = 2.0**-20
ANGLE_GRID_RAD = 2.0**-32
CURVATURE_GRID_PER_M = 2.0**-40


class Road(NamedTuple):
    """The geometry of a corridor, ready for the kernels."""

    reference: np.ndarray  # (stations, 8): columns of service.world.sim.projection
    # (stations, lanes, 3): left and right boundary offsets (m), NaN where a lane is absent; its rules, a sum of
    # those of service.world.sim.projection
    lanes: np.ndarray
    spacing_m: float  # between stations

    @property
    def length_m(self) -> float:
        return (self.reference.shape[0] - 1) * self.spacing_m


def _on_grid(values: np.ndarray, grid: float) -> np.ndarray:
    return np.round(np.asarray(values, dtype=np.float64) / grid) * grid


def road_of(corridor: Corridor) -> Road:
    """The kernels' tables of a corridor."""
    heading = _on_grid(corridor.ref_heading, ANGLE_GRID_RAD)
    directions = np.array([sincos(angle) for angle in heading])
    reference = np.column_stack(
        [
            _on_grid(corridor.ref_x, LENGTH_GRID_M),
            _on_grid(corridor.ref_y, LENGTH_GRID_M),
            heading,
            directions[:, 1],
            directions[:, 0],
            _on_grid(corridor.ref_curvature, CURVATURE_GRID_PER_M),
            _on_grid(corridor.road_left, LENGTH_GRID_M),
            _on_grid(corridor.road_right, LENGTH_GRID_M),
        ]
    )
    bounds = _on_grid(np.stack([corridor.lane_left.T, corridor.lane_right.T], axis=-1), LENGTH_GRID_M)
    return Road(
        np.ascontiguousarray(reference),
        np.ascontiguousarray(np.concatenate([bounds, _rules(corridor)], axis=-1)),
        float(corridor.ds_m),
    )


def _rules(corridor: Corridor) -> np.ndarray:
    """(stations, lanes, 1): the sum of a lane's rules."""
    found = RESERVED * corridor.reserved.astype(np.int64)
    further = getattr(corridor, "rules", None)  # a recorded road has none
    if further is not None:
        found += CLOSED * further.closed + KEEPS_LEFT * further.keeps_left + KEEPS_RIGHT * further.keeps_right
    return found.T[:, :, None]


def i80_road() -> Road:
    """The built-in I-80 road."""
    return road_of(load_corridor("i80"))


def scene_road(road: "SceneRoad") -> Road:
    """The kernels' tables of a recorded road, whose fields are named as a corridor's."""
    return road_of(cast(Corridor, road))
