"""Measures of criticality of two vehicles at one moment; states are rows of `service.world.agents`.

What either does afterwards is assumed: the other keeps its velocity; headings stay. Boxes touch as of
`service.world.safety.boxes.separation`.
"""

import math

import numpy as np

from service.world import agents as A
from service.world.safety.boxes import time_until_touch

BRAKE_MPS2 = 8.0  # of a car with good tyres on a dry road; where it stands it stays
KICK_MPS2 = 3.0  # full acceleration of a car
STEER_MPS2 = 5.0  # across, that an ordinary driver reaches in an emergency
WORST_MPS2 = 8.0  # in any direction, of both
STEP_S = 0.02  # of what is driven on in thought
AFTER_S = 4.0  # beyond the collision, until when a manoeuvre must not touch
FAR_S = 10.0  # beyond which nothing is told
PRECISION_S = 0.01
MANOEUVRES = ("brake", "kick-down", "left", "right")


def _gap(a: np.ndarray, b: np.ndarray, dx: np.ndarray, dy: np.ndarray) -> np.ndarray:
    """`separation` of the boxes for each distance (dx, dy) of their centres, (n,)."""
    la, wa, lb, wb = 0.5 * a[A.LENGTH_M], 0.5 * a[A.WIDTH_M], 0.5 * b[A.LENGTH_M], 0.5 * b[A.WIDTH_M]
    cosine = abs(a[A.COS] * b[A.COS] + a[A.SIN] * b[A.SIN])
    sine = abs(a[A.COS] * b[A.SIN] - a[A.SIN] * b[A.COS])
    sides = (
        np.abs(dx * a[A.COS] + dy * a[A.SIN]) - la - lb * cosine - wb * sine,
        np.abs(dy * a[A.COS] - dx * a[A.SIN]) - wa - lb * sine - wb * cosine,
        np.abs(dx * b[A.COS] + dy * b[A.SIN]) - lb - la * cosine - wa * sine,
        np.abs(dy * b[A.COS] - dx * b[A.SIN]) - wb - la * sine - wa * cosine,
    )
    found: np.ndarray = np.maximum.reduce(sides)
    return found


def _apart(a: np.ndarray, b: np.ndarray, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The other's centre from the ego's, t seconds on, if both keep their velocities."""
    dx, dy = b[A.X_M] - a[A.X_M], b[A.Y_M] - a[A.Y_M]
    vx = b[A.SPEED_MPS] * b[A.COS] - a[A.SPEED_MPS] * a[A.COS]
    vy = b[A.SPEED_MPS] * b[A.SIN] - a[A.SPEED_MPS] * a[A.SIN]
    return dx + vx * t, dy + vy * t


def worst_time_to_collision(a: np.ndarray, b: np.ndarray, acceleration_mps2: float = WORST_MPS2) -> float:
    """WTTC (s): until the boxes could touch if both sped up towards each other in the worst direction.

    The idea of Wachenfeld et al. (2016, IEEE IV), with boxes in place of circles: the first time at which the gap of
    boxes that keep their velocities is at most what both can make up, acceleration t^2. At most FAR_S, then infinite.
    """
    t = np.arange(0.0, FAR_S, STEP_S)
    reach = _gap(a, b, *_apart(a, b, t)) - acceleration_mps2 * t * t
    touched = np.flatnonzero(reach <= 0.0)
    if not touched.size:
        return math.inf
    first = int(touched[0])
    if first == 0:
        return 0.0
    before, after = float(reach[first - 1]), float(reach[first])
    return float(t[first - 1]) + STEP_S * before / (before - after)


def brake_threat_number(a: np.ndarray, b: np.ndarray, brake_mps2: float = BRAKE_MPS2) -> float:
    """BTN: the deceleration that the ego needs so as not to run into the other, over what it has; 0 where it does not
    close in on it, above 1 where braking alone does not do any more.

    v^2 / (2 gap) by the speed and the gap along the ego's heading (Brannstrom et al. 2008), for another whose box lies
    in the strip that the ego's will sweep, and that keeps its velocity.
    """
    dx, dy = b[A.X_M] - a[A.X_M], b[A.Y_M] - a[A.Y_M]
    cosine = abs(a[A.COS] * b[A.COS] + a[A.SIN] * b[A.SIN])
    sine = abs(a[A.COS] * b[A.SIN] - a[A.SIN] * b[A.COS])
    across = abs(dy * a[A.COS] - dx * a[A.SIN])
    half = 0.5 * (b[A.LENGTH_M] * sine + b[A.WIDTH_M] * cosine)
    if across >= 0.5 * a[A.WIDTH_M] + half:
        return 0.0
    ahead = dx * a[A.COS] + dy * a[A.SIN]
    gap = ahead - 0.5 * (a[A.LENGTH_M] + b[A.LENGTH_M] * cosine + b[A.WIDTH_M] * sine)
    closing = a[A.SPEED_MPS] - b[A.SPEED_MPS] * (a[A.COS] * b[A.COS] + a[A.SIN] * b[A.SIN])
    if ahead <= 0.0 or closing <= 0.0:
        return 0.0
    return math.inf if gap <= 0.0 else float(closing * closing / (2.0 * gap) / brake_mps2)


def _moved(a: np.ndarray, manoeuvre: str, t: np.ndarray, begins_s: float) -> tuple[np.ndarray, np.ndarray]:
    """How far (along, across to the left) of where it would be at its velocity a manoeuvre has taken the ego."""
    since = np.maximum(t - begins_s, 0.0)
    nothing = np.zeros_like(t)
    if manoeuvre == "brake":
        stops = a[A.SPEED_MPS] / BRAKE_MPS2
        braking = np.minimum(since, stops)
        return -0.5 * BRAKE_MPS2 * braking * braking - a[A.SPEED_MPS] * (since - braking), nothing
    if manoeuvre == "kick-down":
        return 0.5 * KICK_MPS2 * since * since, nothing
    side = 1.0 if manoeuvre == "left" else -1.0
    return nothing, side * 0.5 * STEER_MPS2 * since * since


def time_to_manoeuvre(a: np.ndarray, b: np.ndarray, manoeuvre: str) -> float:
    """How long (s) the ego can still wait until the manoeuvre alone does not avoid the collision any more.

    Infinite where there is none to avoid within FAR_S, minus infinity where it is too late at once (Hillenbrand et al.
    2006; Tamke et al. 2011). brake: BRAKE_MPS2 to a standstill; kick-down: KICK_MPS2; left, right: STEER_MPS2 across,
    from one moment to the next.
    """
    touch_s = time_until_touch(a, b)
    if touch_s > FAR_S:
        return math.inf
    t = np.arange(0.0, touch_s + AFTER_S, STEP_S)
    dx, dy = _apart(a, b, t)

    def avoids(begins_s: float) -> bool:
        along, left = _moved(a, manoeuvre, t, begins_s)
        x = dx - along * a[A.COS] + left * a[A.SIN]
        y = dy - along * a[A.SIN] - left * a[A.COS]
        return bool(np.all(_gap(a, b, x, y) > 0.0))

    if not avoids(0.0):
        return -math.inf
    low, high = 0.0, touch_s
    while high - low > PRECISION_S:
        middle = 0.5 * (low + high)
        low, high = (middle, high) if avoids(middle) else (low, middle)
    return low


def time_to_brake(a: np.ndarray, b: np.ndarray) -> float:
    """TTB (s): `time_to_manoeuvre` by braking."""
    return time_to_manoeuvre(a, b, "brake")


def time_to_react(a: np.ndarray, b: np.ndarray) -> float:
    """TTR (s): how long until none of the manoeuvres avoids the collision any more; other vehicles and the road's edge
    are left out of account."""
    return max(time_to_manoeuvre(a, b, one) for one in MANOEUVRES)
