"""What a pilot climbs on its way to a contact: how near a state is to one, by gaps along and across the road.

Times to collision lead nowhere: most short ones are of followers who brake in time, and most contacts come from the
side, out of a time to collision that is infinite a second before.
"""

import numpy as np

from policies.jit import kernel
from service.world import agents as A
from service.world.paths.states import States

SECONDS_A_METRE = 4.0  # of lateral gap
LEAST_CLOSING_MPS = 1.0
FARTHEST_S = 8.0


@kernel
def level_of(gap_m: float, room_m: float, closing_mps: float) -> float:
    """How near two vehicles are to a contact, s: the gap along over the closing speed, and a share of that across.

    gap_m: along the road, below 0 where they are beside each other; room_m: across
    closing_mps: rate at which the gap along shrinks
    """
    if closing_mps <= 0.0 and gap_m > 0.0:
        return FARTHEST_S
    along_s = max(gap_m, 0.0) / max(closing_mps, LEAST_CLOSING_MPS)
    return min(along_s + SECONDS_A_METRE * max(room_m, 0.0), FARTHEST_S)


@kernel
def _lower(agents: np.ndarray, ego: int, spacing_m: float, nearest: np.ndarray) -> None:
    for r in range(nearest.size):
        me = agents[r, ego]
        own = me[A.STATION] * spacing_m + me[A.ALONG_M]
        for j in range(agents.shape[1]):
            you = agents[r, j]
            if j == ego or you[A.ACTIVE] == 0.0:
                continue
            along = you[A.STATION] * spacing_m + you[A.ALONG_M] - own
            faster = you[A.SPEED_MPS] - me[A.SPEED_MPS]
            nearest[r] = min(
                nearest[r],
                level_of(
                    abs(along) - 0.5 * (me[A.LENGTH_M] + you[A.LENGTH_M]),
                    abs(you[A.OFFSET_M] - me[A.OFFSET_M]) - 0.5 * (me[A.WIDTH_M] + you[A.WIDTH_M]),
                    -faster if along > 0.0 else faster,
                ),
            )


def lower_nearest(states: States, ego: int, spacing_m: float) -> None:
    """Take the level of the states as they stand into their smallest so far; ego: its row."""
    _lower(states.agents, ego, spacing_m, states.nearest)


def climbed_of(states: States) -> np.ndarray:
    """(n,): the measure where it is at most 0, a contact; the smallest level so far, above 0, elsewhere."""
    above = np.maximum(states.nearest, np.nextafter(0.0, 1.0))
    return np.where((states.smallest <= 0.0) | np.isnan(states.smallest), states.smallest, above)
