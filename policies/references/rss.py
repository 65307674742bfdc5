"""`rss`: a driver who brakes when his distances are not safe by responsibility-sensitive safety."""

from collections.abc import Sequence

from policies.references.careful import HARDEST_MPS2, JERK_MPS3
from policies.references.protocol import Delayed, Other, Own

RESPONSE_S = 0.75
ACCELERATION_MPS2 = 3.0  # of the vehicle behind, during its response time
BRAKE_MPS2 = 6.0  # of both, then
MARGIN_M = 0.3  # across the road, for the small movements within a lane
ACROSS_MPS2 = 1.0  # acceleration across the road


class SensitiveDriver(Delayed):
    """Responsibility-sensitive safety (Shalev-Shwartz, Shammah and Shashua 2017, Definitions 1 and 6) as a driver.

    He brakes 0.75 s after neither the distance along the road nor the one across it is safe to a vehicle ahead, up to
    0.774 g at 12.65 m/s^3. Constants as in the public comparison of models for UN Regulation 157 (ec-jrc/JRC-FSM):
    response time 0.75 s, acceleration 3 m/s^2, braking of both 6 m/s^2, margin across 0.3 m. Across the road the other
    counts as coming at its speed, whichever way, and speeding up with 1 m/s^2; the driver himself goes straight.
    """

    name = "rss"

    def __init__(self) -> None:
        super().__init__(RESPONSE_S)

    def act(self, own: Own, others: Sequence[Other], dt_s: float) -> float:
        if not any(_unsafe(own, other) for other in others) or self.waits(dt_s):
            return 0.0
        return -self.builds_up(JERK_MPS3, HARDEST_MPS2, dt_s)


def _unsafe(own: Own, other: Other) -> bool:
    if not other.ahead:
        return False
    u, ahead, tau = own.speed_mps, other.speed_mps, RESPONSE_S
    reached = u + tau * ACCELERATION_MPS2
    along = u * tau + 0.5 * ACCELERATION_MPS2 * tau * tau
    along += reached * reached / (2.0 * BRAKE_MPS2) - ahead * ahead / (2.0 * BRAKE_MPS2)
    if other.gap_along_m >= along:
        return False
    speed = abs(other.towards_mps)
    faster = speed + ACROSS_MPS2 * tau
    across = MARGIN_M + 0.5 * (speed + faster) * tau + faster * faster / (2.0 * ACROSS_MPS2)
    return other.gap_across_m < across
