"""`r157-5.2.5.2`: what UN Regulation 157 demands of the system itself where another vehicle cuts in."""

from collections.abc import Sequence

from policies.references.protocol import Delayed, Other, Own

HARDEST_MPS2 = 6.0
DELAY_S = 0.35
STEP_S = 0.1  # beyond the regulation's bound, as in the model's public code
WITHIN_M = 0.5  # a vehicle this close across the road is cutting in


def avoidable_s(closing_mps: float, braking_mps2: float, delay_s: float) -> float:
    """Time to collision (s) above which braking in time avoids the collision.

    closing_mps: speed at which the driver closes in
    braking_mps2: deceleration, there at once
    delay_s: until it begins

    >>> [round(avoidable_s(v / 3.6, 6.0, 0.3 / 2.0 + 0.1), 2) for v in (10, 20, 30, 40, 50, 60)]
    [0.48, 0.71, 0.94, 1.18, 1.41, 1.64]
    """
    return closing_mps / (2.0 * braking_mps2) + delay_s


class ParagraphDriver(Delayed):
    """The bound of UN Regulation 157, paragraph 5.2.5.2, as a driver.

    A cut-in is to be avoided where the time to collision at the intrusion exceeds v_rel / (2 x 6 m/s^2) + 0.35 s. The
    driver reacts where it is at most that and a step of 0.1 s, to a vehicle within 0.5 m across the road, and brakes
    with 6 m/s^2 after 0.35 s.
    """

    name = "r157-5.2.5.2"

    def __init__(self) -> None:
        super().__init__(DELAY_S)

    def act(self, own: Own, others: Sequence[Other], dt_s: float) -> float:
        if not any(self._cuts_in(own, other) for other in others) or self.waits(dt_s):
            return 0.0
        return -HARDEST_MPS2

    def _cuts_in(self, own: Own, other: Other) -> bool:
        if not other.ahead or other.gap_across_m > WITHIN_M:
            return False
        limit_s = avoidable_s(own.speed_mps - other.speed_mps, HARDEST_MPS2, DELAY_S + STEP_S)
        return other.time_to_collision_s(own) <= limit_s
