"""Names for ways to fail, by rules on the motion before the moment: what happened, and from which side.

The kinds follow the pre-crash scenarios of NHTSA's typology (Najm, Smith and Yanagisawa, DOT HS 810 767, 2007):
rear-end with a slower or a braking lead vehicle, lane change, drift, from the view of the ego. A conflict is one along
the road where one vehicle stands in the other's path, and one across it where the sides would meet soon; a pass is
neither: the two go by each other closely. The thresholds are quantities of traffic; none is fitted to drivers or egos.
"""

from service.analysis.failures.motion import Motion

HARD_BRAKE_MPS2 = 3.0  # deceleration that counts as hard braking, as in the drivers' realism figures
# a conflict across the road: at the present lateral speeds the sides meet within this time
SIDES_MEET_S = 1.5
NEAR_M = 15.0  # vehicles in different lanes further apart than this along the road do not pass closely

NAMES = {
    "rear-end": "ego runs into the vehicle ahead",
    "rear-end-braking": "ego runs into a braking vehicle ahead",
    "boxed-in": "ego runs into the vehicle ahead, both sides blocked",
    "cut-in-left": "a vehicle cuts in from the left",
    "cut-in-right": "a vehicle cuts in from the right",
    "ego-lane-change-front": "ego changes lanes behind a slower vehicle",
    "rear-ended": "a vehicle from behind runs into the ego",
    "ego-cut-in": "ego cuts in before a faster vehicle",
    "side-swipe-left": "a vehicle on the left comes into the ego's side",
    "side-swipe-right": "a vehicle on the right comes into the ego's side",
    "ego-drift-left": "ego comes into the side of a vehicle on its left",
    "ego-drift-right": "ego comes into the side of a vehicle on its right",
    "pass-left": "ego passes closely by a slower vehicle on its left",
    "pass-right": "ego passes closely by a slower vehicle on its right",
    "passed-left": "a faster vehicle passes the ego closely on its left",
    "passed-right": "a faster vehicle passes the ego closely on its right",
    "other": "none of the named ways",
}


def kind_of(motion: Motion) -> str:
    """A key of NAMES for the motion of one rollout."""
    side = "left" if motion.left_m > 0 else "right"
    if motion.gap_along_m > 0 and (motion.same_lane or motion.gap_across_m <= 0):
        return _along(motion)
    if motion.gap_across_m <= motion.closing_across_mps * SIDES_MEET_S and motion.closing_across_mps > 0:
        return f"{'ego-drift' if _ego_moved(motion) else 'side-swipe'}-{side}"
    if motion.gap_along_m > NEAR_M:
        return "other"
    return f"{'pass' if motion.ego_speed_mps >= motion.other_speed_mps else 'passed'}-{side}"


def _along(motion: Motion) -> str:
    """A conflict along the road: one stands in the other's path."""
    entered = not motion.same_lane_before
    if motion.ahead_m < 0:
        return "ego-cut-in" if entered and _ego_moved(motion) else "rear-ended"
    if entered:
        if _ego_moved(motion):
            return "ego-lane-change-front"
        return "cut-in-left" if motion.before_left_m > 0 else "cut-in-right"
    if motion.left_blocked and motion.right_blocked:
        return "boxed-in"
    return "rear-end-braking" if motion.other_braking_mps2 >= HARD_BRAKE_MPS2 else "rear-end"


def _ego_moved(motion: Motion) -> bool:
    """Whether it was the ego, rather than the other, that came nearer across the road in the window."""
    towards = 1.0 if motion.before_left_m > 0 else -1.0
    ego, other = towards * motion.ego_moved_left_m, -towards * motion.other_moved_left_m
    if max(ego, other) < 0.1:  # hardly any way yet: go by the lateral speeds
        ego, other = towards * motion.ego_across_mps, -towards * motion.other_across_mps
    return ego > other
