"""Where the vehicles are, as the camera wants it."""

import numpy as np

from service.world import agents as A  # columns of a pose; a vehicle whose length is 0 is not there

X_M, Y_M, HEADING_RAD, LENGTH_M, WIDTH_M, ACCELERATION_MPS2 = range(6)
COLUMNS = 6
_FROM_AGENTS = (A.X_M, A.Y_M, A.HEADING_RAD, A.LENGTH_M, A.WIDTH_M, A.ACCELERATION_MPS2)


def poses_of(agents: np.ndarray, count: int | None = None) -> np.ndarray:
    """Poses (n, 6) of the first `count` rows (default: all) of the world's agents.

    Columns: x, y of the centre (m), heading (rad, counter-clockwise from +x), length, width (m), acceleration (m/s^2;
    brake lights). Rows keep their numbers; vehicles that have left the world get length 0.
    """
    rows = agents[: len(agents) if count is None else count]
    poses = rows[:, _FROM_AGENTS]
    poses[rows[:, A.ACTIVE] == 0.0, LENGTH_M] = 0.0
    return poses
