"""`r157-cc`: the competent and careful human driver of UN Regulation 157."""

import math
from collections.abc import Sequence

from policies.references.protocol import Delayed, Other, Own

GRAVITY_MPS2 = 9.81
WANDERING_M = 0.375  # a vehicle this far off its lane's middle is still taken to keep its lane
PERCEPTION_M = 0.72  # further, until a cut-in is perceived: 0.4 s at 1.8 m/s
DELAY_S = 0.75  # from then to the brake
COASTING_MPS2 = 0.4  # meanwhile, off the accelerator
HARDEST_MPS2 = 0.774 * GRAVITY_MPS2
JERK_MPS3 = 12.65  # full force within 0.6 s
CRITICAL_TTC_S = 2.0  # a conflict further away is none
AEB_MPS2, AEB_TTC_S, AEB_FULL_S = 0.85 * GRAVITY_MPS2, 1.5, 0.6


class CarefulDriver(Delayed):
    """The competent and careful human driver of UN Regulation 157 (ECE/TRANS/WP.29/2020/81, Annex 4, Appendix 3).

    A cut-in is perceived when the other is 0.375 m (wandering) and 0.72 m (0.4 s of perception) off its lane's middle
    towards the driver; 0.75 s later he brakes, up to 0.774 g at 12.65 m/s^3, where the time to collision is at most 2 s
    when he perceives it. Until he brakes he is off the accelerator: 0.4 m/s^2, as in the model's public code
    (ec-jrc/JRC-FSM). With the brake assist of the same appendix, 0.85 g come within 0.6 s once the time to collision is
    below 1.5 s.
    """

    def __init__(self, brake_assist: bool = False, perceives_m: float = WANDERING_M + PERCEPTION_M):
        """Make the driver.

        brake_assist: whether automatic emergency braking helps
        perceives_m: distance off its lane's middle from which a cut-in is perceived; infinite: once it is in the way
        """
        self.name = "r157-cc-aeb" if brake_assist else "r157-cc"
        self._brake_assist = brake_assist
        self._perceives_m = perceives_m
        super().__init__(DELAY_S)

    def act(self, own: Own, others: Sequence[Other], dt_s: float) -> float:
        soonest = min((o.time_to_collision_s(own) for o in others if o.in_the_way), default=math.inf)
        if self._brake_assist and soonest <= AEB_TTC_S:
            return -self.builds_up(AEB_MPS2 / AEB_FULL_S, AEB_MPS2, dt_s)
        if not any(self._perceived(o) and o.time_to_collision_s(own) <= CRITICAL_TTC_S for o in others):
            return 0.0
        if self.waits(dt_s):
            self._braking_mps2 = COASTING_MPS2  # which the brake goes on from
            return -COASTING_MPS2
        return -self.builds_up(JERK_MPS3, HARDEST_MPS2, dt_s)

    def _perceived(self, other: Other) -> bool:
        """Whether the other is in the way, or seen to come."""
        if other.in_the_way:
            return True
        return other.ahead and other.towards_mps > 0.0 and self._perceives_m <= other.towards_m < math.inf
