"""Time until the boxes touch; once they do, how fast they hit: one scale on which a contact is always the worst.

Before a contact f is the smallest box time to collision (s), above 0. At the ego's first contact it is minus the speed
of the two vehicles relative to each other (m/s): 0 just touches, -5 hits at 5 m/s. deploy/decisions/0101 says why.
"""

import math

import numpy as np

from policies.jit import kernel
from service.world import agents as A
from service.world.safety.boxes import time_until_touch


@kernel
def relative_speed(a: np.ndarray, b: np.ndarray) -> float:
    """Size (m/s) of the difference of two vehicles' velocities (rows of the agents)."""
    vx = b[A.SPEED_MPS] * b[A.COS] - a[A.SPEED_MPS] * a[A.COS]
    vy = b[A.SPEED_MPS] * b[A.SIN] - a[A.SPEED_MPS] * a[A.SIN]
    return math.sqrt(vx * vx + vy * vy)


@kernel
def time_or_impact(agents: np.ndarray, count: int, ego: int) -> float:
    """Smallest box time to collision (s) of the ego now, or minus the impact speed (m/s) where it is in contact.

    Of several contacts at once the fastest counts; inf where the ego closes in on nobody.
    """
    smallest = math.inf
    for j in range(count):
        if j == ego or agents[j, A.ACTIVE] == 0.0:
            continue
        time_s = time_until_touch(agents[ego], agents[j])
        if time_s == 0.0:
            time_s = 0.0 - relative_speed(agents[ego], agents[j])
        smallest = min(smallest, time_s)
    return smallest
