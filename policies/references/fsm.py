"""`fsm`: the fuzzy safety model of the Joint Research Centre, which brakes early and gently, or late and hard."""

import math
from collections.abc import Sequence

from policies.references.careful import HARDEST_MPS2, JERK_MPS3
from policies.references.protocol import Delayed, Other, Own

DELAY_S = 0.75
BRAKE_LEAST_MPS2, BRAKE_MOST_MPS2 = 4.0, 6.0
BRAKE_AHEAD_MPS2 = 7.0  # that the vehicle ahead may do
STANDING_M = 2.0  # distance kept at a standstill
COMFORT_M = 2.0  # beyond the proactive distance
STEP_S = 0.1


class FuzzyDriver(Delayed):
    """The fuzzy safety model (Mattas et al. 2020, Accident Analysis & Prevention 148, 105794; and 2022, 174, 106743).

    Two surrogates between 0 and 1: the proactive one (PFS) asks what happens if the vehicle ahead brakes as hard as it
    can, the critical one (CFS) what happens if both go on as they do. Where either is above 0 the driver brakes after
    0.75 s: with CFS (6 - 4) + 4 m/s^2 where CFS is above 0, else with PFS 4 m/s^2. A vehicle that comes across counts
    where it would be in the way before the driver has passed it.
    """

    name = "fsm"

    def __init__(self) -> None:
        super().__init__(DELAY_S)

    def act(self, own: Own, others: Sequence[Other], dt_s: float) -> float:
        near = [other for other in others if _counts(own, other)]
        cfs = max((critical(own, other) for other in near), default=0.0)
        pfs = max((proactive(own, other) for other in near), default=0.0)
        if (cfs <= 0.0 and pfs <= 0.0) or self.waits(dt_s):
            return 0.0
        if cfs > 0.0:
            wanted = cfs * (BRAKE_MOST_MPS2 - BRAKE_LEAST_MPS2) + BRAKE_LEAST_MPS2
        else:
            wanted = pfs * BRAKE_LEAST_MPS2
        return -self.builds_up(JERK_MPS3, min(HARDEST_MPS2, wanted), dt_s)


def _counts(own: Own, other: Other) -> bool:
    """Whether the other is ahead and in the way, or will be by the time that the driver needs to pass it."""
    if not other.ahead:
        return False
    if other.gap_across_m <= 0.0:
        return True
    closing = own.speed_mps - other.speed_mps
    if other.towards_mps <= 0.0 or closing < 0.0:
        return False
    passed_s = (other.gap_along_m + 2.0 * other.lengths_m) / closing if closing > 0.0 else math.inf
    return other.gap_across_m / other.towards_mps <= passed_s + STEP_S


def proactive(own: Own, other: Other) -> float:
    """PFS: 0 where the gap is safe even if the vehicle ahead brakes with 7 m/s^2, 1 where it is not by 6 m/s^2."""
    gap = other.gap_along_m - STANDING_M
    u, ahead = own.speed_mps, other.speed_mps
    reacting = u * DELAY_S - ahead * ahead / (2.0 * BRAKE_AHEAD_MPS2)
    safe = reacting + u * u / (2.0 * BRAKE_LEAST_MPS2) + COMFORT_M
    unsafe = reacting + u * u / (2.0 * BRAKE_MOST_MPS2)
    return _between(gap, safe, unsafe)


def critical(own: Own, other: Other) -> float:
    """CFS: 0 where braking with 4 m/s^2 after the delay avoids a collision at the other's speed, 1 where 6 do not."""
    u, ahead = own.speed_mps, other.speed_mps
    if u <= ahead:
        return 0.0
    acceleration = max(own.acceleration_mps2, -BRAKE_LEAST_MPS2)
    then = u + acceleration * DELAY_S
    if then < ahead:  # the braking that there is makes the speeds equal within the delay
        return 1.0 if other.gap_along_m < (u - ahead) ** 2 / abs(2.0 * own.acceleration_mps2) else 0.0
    reacting = (u + 0.5 * acceleration * DELAY_S - ahead) * DELAY_S
    closing = then - ahead
    safe = reacting + closing * closing / (2.0 * BRAKE_LEAST_MPS2)
    unsafe = reacting + closing * closing / (2.0 * BRAKE_MOST_MPS2)
    return _between(other.gap_along_m, safe, unsafe)


def _between(gap: float, safe: float, unsafe: float) -> float:
    """0 at `safe` and beyond, 1 at `unsafe` and below, linear in between."""
    if gap >= safe:
        return 0.0
    if gap <= unsafe:
        return 1.0
    return (safe - gap) / (safe - unsafe)
