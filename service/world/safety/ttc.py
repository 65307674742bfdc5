"""Time to collision by rays, the paper's safety measure (Appendix A).

From the ego's centre, rays at equal angles; ray i hits a vehicle at range s_i with range rate r_i:
TTC_i = s_i / max(-r_i, 0), infinite when not closing. The measure of a rollout is the minimum over rays and
steps. Ranges are measured to the centre, so it stays positive at a crash, when the boxes meet and the rollout
ends; an ego whose centre lies inside another vehicle has TTC 0.
"""

import math

import numpy as np

from policies.jit import kernel
from service.world.sensors.lidar import scan


@kernel
def time_to_collision(ranges: np.ndarray, rates: np.ndarray) -> float:
    """Smallest time to collision (s) over the rays of one scan; ranges (m) and rates (m/s): (rays,)."""
    smallest = math.inf
    for i in range(ranges.shape[0]):
        if rates[i] < 0.0:
            smallest = min(smallest, ranges[i] / -rates[i])
    return smallest


@kernel
def ego_time_to_collision(
    agents: np.ndarray, count: int, ego: int, rays: np.ndarray, ranges: np.ndarray, rates: np.ndarray
) -> float:
    """Time to collision (s) of vehicle `ego` now; `ranges` and `rates` (rays,) are filled on the way."""
    scan(agents, count, ego, rays, math.inf, ranges, rates)
    return time_to_collision(ranges, rates)
