"""Two vehicles' boxes that keep their velocities: when they touch, and how far they are apart."""

import math

import numpy as np

from policies.jit import kernel
from service.world import agents as A

PARALLEL_MPS = 1e-12  # slower than this along an axis, two boxes stay as far apart there as they are


@kernel
def separation(
    ax: float, ay: float, acos: float, asin: float, alength: float, awidth: float,
    bx: float, by: float, bcos: float, bsin: float, blength: float, bwidth: float,
) -> float:  # fmt: skip
    """Gap (m) between two oriented boxes along the axis of the four that shows the widest; <= 0 where they overlap.

    It is the distance wherever two sides face each other, and at most the distance at corners.
    """
    dx, dy = bx - ax, by - ay
    la, wa, lb, wb = 0.5 * alength, 0.5 * awidth, 0.5 * blength, 0.5 * bwidth
    cosine = abs(acos * bcos + asin * bsin)
    sine = abs(acos * bsin - asin * bcos)
    gap = abs(dx * acos + dy * asin) - la - lb * cosine - wb * sine
    gap = max(gap, abs(dy * acos - dx * asin) - wa - lb * sine - wb * cosine)
    gap = max(gap, abs(dx * bcos + dy * bsin) - lb - la * cosine - wa * sine)
    return max(gap, abs(dy * bcos - dx * bsin) - wb - la * sine - wa * cosine)


@kernel
def clearance(agents: np.ndarray, count: int, ego: int) -> float:
    """Smallest `separation` (m) of the ego's box from another's; inf where it is alone."""
    smallest = math.inf
    a = agents[ego]
    for j in range(count):
        b = agents[j]
        if j == ego or b[A.ACTIVE] == 0.0:
            continue
        gap = separation(
            a[A.X_M], a[A.Y_M], a[A.COS], a[A.SIN], a[A.LENGTH_M], a[A.WIDTH_M],
            b[A.X_M], b[A.Y_M], b[A.COS], b[A.SIN], b[A.LENGTH_M], b[A.WIDTH_M],
        )  # fmt: skip
        smallest = min(smallest, gap)
    return smallest


@kernel
def _narrow(gap: float, speed: float, reach: float, entry: float, leave: float) -> tuple[float, float]:
    """The times [entry, leave] in which the boxes overlap along one more axis.

    gap: of the centres along it (m)
    speed: its rate (m/s)
    reach: half the boxes' extents together (m)
    """
    if abs(speed) < PARALLEL_MPS:
        if abs(gap) > reach:
            return math.inf, -math.inf
        return entry, leave
    first = (-reach - gap) / speed
    second = (reach - gap) / speed
    return max(entry, min(first, second)), min(leave, max(first, second))


@kernel
def time_until_touch(a: np.ndarray, b: np.ndarray) -> float:
    """Time (s) until the boxes of two vehicles (rows of the agents) touch if both keep velocity and heading.

    0 where they do already, inf where they never will. Boxes that only translate overlap exactly while their
    projections overlap along all four of their axes (separating axis theorem).
    """
    dx, dy = b[A.X_M] - a[A.X_M], b[A.Y_M] - a[A.Y_M]
    vx = b[A.SPEED_MPS] * b[A.COS] - a[A.SPEED_MPS] * a[A.COS]
    vy = b[A.SPEED_MPS] * b[A.SIN] - a[A.SPEED_MPS] * a[A.SIN]
    la, wa, lb, wb = 0.5 * a[A.LENGTH_M], 0.5 * a[A.WIDTH_M], 0.5 * b[A.LENGTH_M], 0.5 * b[A.WIDTH_M]
    cosine = abs(a[A.COS] * b[A.COS] + a[A.SIN] * b[A.SIN])
    sine = abs(a[A.COS] * b[A.SIN] - a[A.SIN] * b[A.COS])
    entry, leave = 0.0, math.inf
    entry, leave = _narrow(dx * a[A.COS] + dy * a[A.SIN], vx * a[A.COS] + vy * a[A.SIN],
                           la + lb * cosine + wb * sine, entry, leave)  # fmt: skip
    entry, leave = _narrow(dy * a[A.COS] - dx * a[A.SIN], vy * a[A.COS] - vx * a[A.SIN],
                           wa + lb * sine + wb * cosine, entry, leave)  # fmt: skip
    entry, leave = _narrow(dx * b[A.COS] + dy * b[A.SIN], vx * b[A.COS] + vy * b[A.SIN],
                           lb + la * cosine + wa * sine, entry, leave)  # fmt: skip
    entry, leave = _narrow(dy * b[A.COS] - dx * b[A.SIN], vy * b[A.COS] - vx * b[A.SIN],
                           wb + la * sine + wa * cosine, entry, leave)  # fmt: skip
    return entry if entry <= leave else math.inf


@kernel
def box_time_to_collision(agents: np.ndarray, count: int, ego: int) -> float:
    """Smallest time (s) until the ego's box touches another's at constant velocities; inf for never."""
    smallest = math.inf
    for j in range(count):
        if j != ego and agents[j, A.ACTIVE] != 0.0:
            smallest = min(smallest, time_until_touch(agents[ego], agents[j]))
    return smallest
