"""Required deceleration (DRAC): how hard a vehicle must brake so as not to run into the one ahead of it."""

import numpy as np

from policies.jit import kernel
from service.world import agents as A
from service.world.safety.lane_frame import beside

MOST_MPS2 = 100.0  # what is said where boxes overlap: no deceleration helps any more


@kernel
def required_deceleration(agents: np.ndarray, count: int, ego: int) -> float:
    """The hardest deceleration (m/s^2) that the ego, or a vehicle behind it, needs now; 0 where none closes in.

    Of vehicles in each other's way, the one behind needs (difference of speeds)^2 / (2 gap) if the one ahead keeps its
    speed (Cooper and Ferguson 1976); along the road, see `service.world.safety.lane_frame`. At most MOST_MPS2.
    """
    hardest = 0.0
    for j in range(count):
        if j == ego or agents[j, A.ACTIVE] == 0.0:
            continue
        along, _, gap, gap_across, mine, _, yours, _ = beside(agents, ego, j)
        if gap_across >= 0.0:
            continue
        closing = mine - yours if along >= 0.0 else yours - mine
        if gap <= 0.0:
            hardest = MOST_MPS2
        elif closing > 0.0:
            hardest = max(hardest, min(closing * closing / (2.0 * gap), MOST_MPS2))
    return hardest
