"""Cut-ins on a grid, driven by reference drivers: the public comparison of models for UN Regulation 157, to be counted
again.

A vehicle ahead in the next lane comes over at a constant lateral speed, reached with 1.5 m/s^2, and keeps its speed
along the road. The ranges, sizes and the order of a step are those of the repository ec-jrc/JRC-FSM (commit 01b05c2).
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from policies.references.protocol import Other, Own, ReferenceDriver

LENGTH_M, WIDTH_M = 4.3, 1.9
BETWEEN_M = 1.6  # between the boxes when both are in the middle of their lanes, 3.5 m wide
HZ = 10  # steps a second
STEP_S = 1.0 / HZ
STEPS = 350
LATERAL_ACCELERATION_MPS2 = 1.5
LATERAL_MPS = np.arange(0.0, 1.8, 0.1)


@dataclass(frozen=True)
class CutIn:
    """One cut-in: speeds along the road, the gap between the boxes and the lateral speed when it begins."""

    own_kmh: float
    other_kmh: float
    gap_m: float
    lateral_mps: float


def cut_ins(own_kmh: int, other_kmh: int) -> Iterator[CutIn]:
    """The grid for a pair of speeds, standing still across the road left out: gaps of 1 to 119 m in steps of 2 m at 70
    km/h and above, of 1 to 59 m in steps of 1 m below."""
    for gap in range(1, 120, 2) if own_kmh >= 70 else range(1, 60):
        for lateral in LATERAL_MPS[1:].tolist():
            yield CutIn(own_kmh, other_kmh, float(gap), lateral)


def _lateral(case: CutIn) -> tuple[np.ndarray, np.ndarray, int]:
    """Lateral speeds (towards the driver, m/s) and distances between the centres (m) of the one that cuts in, at each
    state, and how many states lie before the lateral speed is reached."""
    speeding = np.arange(0.0, case.lateral_mps, LATERAL_ACCELERATION_MPS2 / HZ)
    begins = BETWEEN_M + WIDTH_M
    going = int(begins * HZ // case.lateral_mps + 1)
    then = np.array(([case.lateral_mps] * going + [0.0] * STEPS)[:STEPS])
    before = begins + np.cumsum(speeding[::-1])[::-1] * STEP_S
    across = np.concatenate([before, [begins], begins - np.cumsum(then) * STEP_S])
    return np.concatenate([speeding, [case.lateral_mps], then]), across, speeding.size


def collides(case: CutIn, driver: ReferenceDriver, critical_s: float = math.inf) -> bool:
    """Whether the driver, who goes straight on at his speed until he brakes, collides with the one that cuts in.

    critical_s: of a vehicle that comes into the way with a longer time to collision the comparison says that it has
        not cut in: no collision, whatever follows
    """
    driver.reset()
    lateral, across, before = _lateral(case)
    speed, other_speed = case.own_kmh / 3.6, case.other_kmh / 3.6
    # where the centres are when the lateral speed is reached; before that both have kept their speeds
    ahead = case.gap_m + LENGTH_M - before * STEP_S * (other_speed - speed)
    acceleration = 0.0
    for k in range(STEPS + before - 1):
        gap_along, gap_across = abs(ahead) - LENGTH_M, abs(float(across[k])) - WIDTH_M
        if gap_along < 0.0 and gap_across < 0.0:
            return True
        off = BETWEEN_M + WIDTH_M - float(across[k])
        other = Other(ahead >= 0.0, gap_along, gap_across, other_speed, float(lateral[k]), off, LENGTH_M)
        own = Own(speed, acceleration)
        if other.in_the_way and critical_s < other.time_to_collision_s(own) < math.inf:
            return False
        asked = driver.act(own, [other], STEP_S)
        faster = max(speed + asked * STEP_S, 0.0)
        acceleration, speed = (faster - speed) / STEP_S, faster
        ahead += (other_speed - speed) * STEP_S
    return False
