"""How near two vehicles come if they go on as they move now: what a committor should not have to learn of a pair.

The gaps along and across the road are each divided by a spread that grows with time, as where somebody will be is
less and less certain. A conflict from behind, from ahead or from the side is near in the same way, so that a kind of
conflict that has been met a few times is known by the many of another kind.
"""

import math

from policies.jit import kernel

STEP_S, STEPS = 0.25, 21  # of the way ahead
ALONG_M, ALONG_MPS = 0.5, 0.8  # spread of the gap along now, and by how much it grows
ACROSS_M, ACROSS_MPS = 0.25, 0.35
BRAKING_S = 1.5  # for which a difference of accelerations is taken to last
FARTHEST = 8.0


@kernel
def nearest(
    along_m: float, across_m: float, along_mps: float, across_mps: float, along_mps2: float, length_m: float,
    width_m: float,
) -> tuple[float, float, float, float]:  # fmt: skip
    """Least distance in spreads, FARTHEST at most, when that is, in s, and the gaps along and across then, in m.

    along_m, across_m: from one centre to the other; along_mps, across_mps: their rates; along_mps2: of the first rate
    length_m, width_m: means of both vehicles
    """
    least, when_s, gap_along_m, gap_across_m = math.inf, 0.0, 0.0, 0.0
    for k in range(STEPS):
        t = k * STEP_S
        gained = 0.5 * t * t if t <= BRAKING_S else BRAKING_S * (t - 0.5 * BRAKING_S)
        along = max(abs(along_m + along_mps * t + along_mps2 * gained) - length_m, 0.0)
        across = max(abs(across_m + across_mps * t) - width_m, 0.0)
        a, b = along / (ALONG_M + ALONG_MPS * t), across / (ACROSS_M + ACROSS_MPS * t)
        distance = a * a + b * b
        if distance < least:
            least, when_s, gap_along_m, gap_across_m = distance, t, along, across
    return min(math.sqrt(least), FARTHEST), when_s, gap_along_m, gap_across_m
