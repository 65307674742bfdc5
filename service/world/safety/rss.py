"""Responsibility-sensitive safety (Shalev-Shwartz, Shammah and Shashua 2017): margins over the safe distances.

Two vehicles are in danger when neither the distance along the road nor the one across it is safe (their Definition 10),
so a pair's margin is the larger of the two, and below 0 is dangerous. Everything in metres.
"""

import math

import numpy as np

from policies.jit import kernel
from service.world import agents as A
from service.world.safety.lane_frame import beside
from service.world.scenario.schema import Scenario

# columns of the parameters' array, in the order of service.world.scenario.schema.Rss
RESPONSE_S, ACCELERATION, BRAKE_LEAST, BRAKE_MOST, ACROSS_ACCELERATION, ACROSS_BRAKE, ACROSS_MARGIN_M = range(
    7
)
BOTH, ALONG, ACROSS = range(3)


@kernel
def safe_distance_along(rear_mps: float, front_mps: float, rss: np.ndarray) -> float:
    """Least safe gap (m) behind a vehicle in front (Definition 1): it brakes as hard as it can while the one behind
    speeds up for its response time, then brakes as hard as is asked of it at least. Speeds below 0 count as 0."""
    rear, front = max(rear_mps, 0.0), max(front_mps, 0.0)
    reached = rear + rss[RESPONSE_S] * rss[ACCELERATION]
    need = rear * rss[RESPONSE_S] + 0.5 * rss[ACCELERATION] * rss[RESPONSE_S] * rss[RESPONSE_S]
    need += reached * reached / (2.0 * rss[BRAKE_LEAST]) - front * front / (2.0 * rss[BRAKE_MOST])
    return max(need, 0.0)


@kernel
def _drift(speed_mps: float, rss: np.ndarray) -> float:
    """How far (m) a vehicle comes across towards the other until it has stopped to do so; negative: away from it."""
    reached = speed_mps + rss[RESPONSE_S] * rss[ACROSS_ACCELERATION]
    return 0.5 * (speed_mps + reached) * rss[RESPONSE_S] + reached * abs(reached) / (2.0 * rss[ACROSS_BRAKE])


@kernel
def safe_distance_across(mine_mps: float, yours_mps: float, rss: np.ndarray) -> float:
    """Least safe gap (m) between vehicles side by side (Definition 6); speeds towards each other.

    The paper writes the braking distances without their sign; one that moves away keeps its sign here.
    """
    return rss[ACROSS_MARGIN_M] + max(_drift(mine_mps, rss) + _drift(yours_mps, rss), 0.0)


@kernel
def rss_margin(agents: np.ndarray, count: int, ego: int, rss: np.ndarray, which: int) -> float:
    """Smallest margin (m) of the ego over all others; inf where there is none to be compared.

    which: BOTH, the larger of a pair's two margins; ALONG, that along the road, of vehicles in each other's way;
        ACROSS, that across it, of vehicles side by side
    """
    smallest = math.inf
    for j in range(count):
        if j == ego or agents[j, A.ACTIVE] == 0.0:
            continue
        along, across, gap_along, gap_across, my_along, my_across, your_along, your_across = beside(
            agents, ego, j
        )
        if along >= 0.0:
            margin_along = gap_along - safe_distance_along(my_along, your_along, rss)
        else:
            margin_along = gap_along - safe_distance_along(your_along, my_along, rss)
        if across >= 0.0:
            margin_across = gap_across - safe_distance_across(my_across, -your_across, rss)
        else:
            margin_across = gap_across - safe_distance_across(-my_across, your_across, rss)
        if which == BOTH:
            smallest = min(smallest, max(margin_along, margin_across))
        elif which == ALONG and gap_across < 0.0:
            smallest = min(smallest, margin_along)
        elif which == ACROSS and gap_along < 0.0:
            smallest = min(smallest, margin_across)
    return smallest


def rss_parameters(scenario: Scenario) -> np.ndarray:
    """The scenario's RSS parameters as the kernels read them."""
    r = scenario.safety.rss
    return np.array(
        [
            r.response_s,
            r.acceleration_mps2,
            r.least_braking_mps2,
            r.hardest_braking_mps2,
            r.lateral_acceleration_mps2,
            r.lateral_braking_mps2,
            r.lateral_margin_m,
        ]
    )
