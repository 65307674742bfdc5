"""Lidar: rays from a vehicle's centre against the other vehicles' boxes."""

import math

import numpy as np

from policies.exactmath import sincos
from policies.jit import kernel
from service.world.agents import ACTIVE, COS, LENGTH_M, SIN, SPEED_MPS, WIDTH_M, X_M, Y_M

PARALLEL = 1e-12  # a beam's component below this does not cross a box's pair of sides


def beam_directions(beams: int) -> np.ndarray:
    """Unit vectors (beams, 2) at equal angles, the first straight ahead, counter-clockwise."""
    if beams < 1:
        raise ValueError(f"a lidar needs at least one beam, not {beams}")
    table = np.empty((beams, 2))
    for i in range(beams):
        sine, cosine = sincos(2.0 * math.pi * i / beams)
        table[i] = cosine, sine
    return table


@kernel
def _crossing(d: float, c: float, half: float) -> tuple[float, float]:
    """Distances along a ray between which one of its coordinates, from 0 at rate d, lies in [c - half, c + half]."""
    if abs(d) < PARALLEL:
        return (math.inf, -math.inf) if abs(c) > half else (-math.inf, math.inf)
    a, b = (c - half) / d, (c + half) / d
    return min(a, b), max(a, b)


@kernel
def ray_box(dx: float, dy: float, cx: float, cy: float, half_length: float, half_width: float) -> float:
    """Distance along the unit ray (dx, dy) to a box, both in the box's own axes; inf where it misses.

    (cx, cy) is the box's centre seen from the ray's origin. An origin inside the box has distance 0.
    """
    enters, leaves = _crossing(dx, cx, half_length)
    near, far = max(0.0, enters), leaves
    enters, leaves = _crossing(dy, cy, half_width)
    near, far = max(near, enters), min(far, leaves)
    if near > far:
        return math.inf
    return near


@kernel
def scan(
    agents: np.ndarray,
    count: int,
    own: int,
    beams: np.ndarray,
    limit_m: float,
    ranges: np.ndarray,
    rates: np.ndarray,
) -> None:
    """Fill `ranges` (m) and `rates` (m/s) of vehicle `own` against the first `count` rows of `agents`.

    ranges, rates: (beams,)

    A beam that hits nothing within `limit_m` has range `limit_m` and rate 0. The rate is the hit vehicle's velocity
    relative to the own one along the beam (what a Doppler sensor sees), negative when closing.
    """
    for b in range(beams.shape[0]):
        ranges[b] = limit_m
        rates[b] = 0.0
    me = agents[own]
    vx = me[SPEED_MPS] * me[COS]
    vy = me[SPEED_MPS] * me[SIN]
    for j in range(count):
        other = agents[j]
        if j == own or other[ACTIVE] == 0.0:
            continue
        px = other[X_M] - me[X_M]
        py = other[Y_M] - me[Y_M]
        half_length = 0.5 * other[LENGTH_M]
        half_width = 0.5 * other[WIDTH_M]
        radius2 = half_length * half_length + half_width * half_width
        distance2 = px * px + py * py
        reach = limit_m + half_length + half_width
        if distance2 > reach * reach:
            continue
        # the other's centre in my axes, and the rotation from my axes to the other's
        ahead = px * me[COS] + py * me[SIN]
        left = py * me[COS] - px * me[SIN]
        cosine = me[COS] * other[COS] + me[SIN] * other[SIN]
        sine = me[SIN] * other[COS] - me[COS] * other[SIN]
        cx = px * other[COS] + py * other[SIN]
        cy = py * other[COS] - px * other[SIN]
        ux = other[SPEED_MPS] * other[COS] - vx
        uy = other[SPEED_MPS] * other[SIN] - vy
        closing_ahead = ux * me[COS] + uy * me[SIN]
        closing_left = uy * me[COS] - ux * me[SIN]
        for b in range(beams.shape[0]):
            bx = beams[b, 0]
            by = beams[b, 1]
            across = bx * left - by * ahead
            if across * across > radius2 or (bx * ahead + by * left < 0.0 and distance2 > radius2):
                continue
            hit = ray_box(bx * cosine - by * sine, bx * sine + by * cosine, cx, cy, half_length, half_width)
            if hit < ranges[b]:
                ranges[b] = hit
                rates[b] = closing_ahead * bx + closing_left * by
