"""Another vehicle seen along and across the road from the ego: what RSS and required deceleration are worked out in.

The road near the ego is taken as an arc of its lane's curvature: a vehicle s ahead has moved s^2 curvature / 2 to the
side only because the road does. It needs nothing but the ego's own lane, so it holds for background traffic too.
"""

import numpy as np

from policies.exactmath import sincos
from policies.jit import kernel
from service.world import agents as A


@kernel
def beside(
    agents: np.ndarray, ego: int, other: int
) -> tuple[float, float, float, float, float, float, float, float]:
    """How `other` stands to the ego along the road and across it.

    Returns along and across (m, between the centres, positive ahead and to the left); the gaps between their boxes
    along and across (m, negative where the boxes overlap in that direction); the speeds along and across (m/s) of the
    ego, then of the other.
    """
    me, you = agents[ego], agents[other]
    sine, cosine = sincos(me[A.HEADING_RAD] - me[A.LANE_HEADING_RAD])
    dx, dy = you[A.X_M] - me[A.X_M], you[A.Y_M] - me[A.Y_M]
    along = dx * cosine + dy * sine
    across = dy * cosine - dx * sine - 0.5 * me[A.CURVATURE_PER_M] * along * along
    road = me[A.HEADING_RAD] - me[A.LANE_HEADING_RAD] + me[A.CURVATURE_PER_M] * along
    my_sine, my_cosine = sincos(me[A.LANE_HEADING_RAD])
    your_sine, your_cosine = sincos(you[A.HEADING_RAD] - road)
    long = 0.5 * (me[A.LENGTH_M] * abs(my_cosine) + me[A.WIDTH_M] * abs(my_sine))
    long += 0.5 * (you[A.LENGTH_M] * abs(your_cosine) + you[A.WIDTH_M] * abs(your_sine))
    wide = 0.5 * (me[A.WIDTH_M] * abs(my_cosine) + me[A.LENGTH_M] * abs(my_sine))
    wide += 0.5 * (you[A.WIDTH_M] * abs(your_cosine) + you[A.LENGTH_M] * abs(your_sine))
    return (
        along, across, abs(along) - long, abs(across) - wide,
        me[A.SPEED_MPS] * my_cosine, me[A.SPEED_MPS] * my_sine,
        you[A.SPEED_MPS] * your_cosine, you[A.SPEED_MPS] * your_sine,
    )  # fmt: skip
