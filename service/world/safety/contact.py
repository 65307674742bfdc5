"""Where the ego and another vehicle touch first: which vehicle, which side of each and which part of that side."""

import math
from typing import Literal

import msgspec
import numpy as np

from service.world import agents as A
from service.world.safety.boxes import time_until_touch
from service.world.safety.impact import relative_speed

PARALLEL = 0.09  # sine of the angle (5 degrees) up to which two sides meet along a line, and not at a corner
LONGEST_BACK_S = 1.0  # further back than this no contact of a step began: the boxes stood in each other
THIRD = (
    1.0 / 3.0
)  # of a side's half: its middle part reaches so far from the middle (SAE J224 has thirds, too)


Side = Literal["front", "rear", "left", "right"]
Part = Literal["left", "middle", "right", "front", "rear"]
Who = Literal["ego", "other"]


class Contact(msgspec.Struct, frozen=True):
    """A first touch, seen from both vehicles.

    other: row of the vehicle among the agents
    speed_mps: of one relative to the other
    ahead_mps, left_mps: the other's velocity relative to the ego, along the ego's axes
    ego_side, other_side: "front", "rear", "left" or "right"
    ego_part, other_part: of that side: "left", "middle" or "right" of a front or rear, "front", "middle" or "rear" of a
        side; so "front" and "left" is the front left corner seen from ahead, "left" and "front" seen from the side
    striking: "ego" or "other": whose front it is; where it is nobody's or both's, who moved faster towards the other
    """

    other: int
    speed_mps: float
    ahead_mps: float
    left_mps: float
    ego_side: Side
    ego_part: Part
    other_side: Side
    other_part: Part
    striking: Who


def contact_of(agents: np.ndarray, count: int, ego: int) -> Contact | None:
    """The ego's contact in this state, of several the fastest; None without one.

    The boxes are moved back along their velocities to the moment at which they touched first; the side is that whose
    outward normal is nearest to the direction in which they met.
    """
    touching = [
        j
        for j in range(count)
        if j != ego and agents[j, A.ACTIVE] != 0.0 and time_until_touch(agents[ego], agents[j]) == 0.0
    ]
    if not touching:
        return None
    other = max(touching, key=lambda j: (relative_speed(agents[ego], agents[j]), -j))
    a, b = agents[ego], agents[other]
    normal, back_s = _first_axis(a, b)
    point = _meeting_point(a, b, normal, back_s)
    moved = _centre(a) + back_s * _velocity(a), _centre(b) + back_s * _velocity(b)
    ego_side, ego_part = _where(a, normal, point - moved[0])
    other_side, other_part = _where(b, -normal, point - moved[1])
    relative = _velocity(b) - _velocity(a)
    ahead, left = _axes(a)
    return Contact(
        other,
        float(relative_speed(a, b)),
        float(relative @ ahead),
        float(relative @ left),
        ego_side,
        ego_part,
        other_side,
        other_part,
        _striking(a, b, ego_side, other_side, normal),
    )


def _striking(a: np.ndarray, b: np.ndarray, ego_side: Side, other_side: Side, normal: np.ndarray) -> Who:
    """Who ran into the other.

    normal: the direction from ego to other in which they met
    """
    if (ego_side == "front") != (other_side == "front"):
        return "ego" if ego_side == "front" else "other"
    road = a[A.HEADING_RAD] - a[A.LANE_HEADING_RAD]
    along = np.array([math.cos(road), math.sin(road)])
    if abs(float(normal @ along)) < abs(float(normal @ _left_of(along))):  # side by side: across the road
        normal = math.copysign(1.0, float(normal @ _left_of(along))) * _left_of(along)
    return "ego" if float(_velocity(a) @ normal) > -float(_velocity(b) @ normal) else "other"


def _left_of(direction: np.ndarray) -> np.ndarray:
    return np.array([-direction[1], direction[0]])


def _centre(agent: np.ndarray) -> np.ndarray:
    return agent[[A.X_M, A.Y_M]]


def _axes(agent: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Unit vectors ahead and to the left."""
    c, s = agent[A.COS], agent[A.SIN]
    return np.array([c, s]), np.array([-s, c])


def _velocity(agent: np.ndarray) -> np.ndarray:
    return agent[A.SPEED_MPS] * _axes(agent)[0]


def _reach(agent: np.ndarray, axis: np.ndarray) -> float:
    """Half the extent (m) of a box along an axis."""
    ahead, left = _axes(agent)
    return float(0.5 * (agent[A.LENGTH_M] * abs(ahead @ axis) + agent[A.WIDTH_M] * abs(left @ axis)))


def _first_axis(a: np.ndarray, b: np.ndarray) -> tuple[np.ndarray, float]:
    """The direction from a to b in which they met, and when (s, 0 or before); where they have not moved, the axis along
    which they overlap least, now."""
    gap, rate = _centre(b) - _centre(a), _velocity(b) - _velocity(a)
    latest, met, least, nearest = -math.inf, np.zeros(2), math.inf, np.zeros(2)
    for axis in (*_axes(a), *_axes(b)):
        along, speed, reach = float(gap @ axis), float(rate @ axis), _reach(a, axis) + _reach(b, axis)
        towards = axis if along >= 0.0 else -axis
        if reach - abs(along) < least:
            least, nearest = reach - abs(along), towards
        if speed != 0.0:
            entered = min((-reach - along) / speed, (reach - along) / speed)
            if entered > latest:
                latest, met = entered, axis if along + entered * speed >= 0.0 else -axis
    return (met, min(latest, 0.0)) if latest > -LONGEST_BACK_S else (nearest, 0.0)


def _meeting_point(a: np.ndarray, b: np.ndarray, normal: np.ndarray, back_s: float) -> np.ndarray:
    """Where the boxes meet (m): the middle of what their facing sides or corners share across the normal."""
    across = np.array([-normal[1], normal[0]])
    ends = []
    for agent, out in ((a, normal), (b, -normal)):
        centre = _centre(agent) + back_s * _velocity(agent)
        ahead, left = _axes(agent)
        half = 0.5 * agent[A.LENGTH_M] * ahead, 0.5 * agent[A.WIDTH_M] * left
        corners = [centre + i * half[0] + k * half[1] for i in (-1.0, 1.0) for k in (-1.0, 1.0)]
        corners.sort(key=lambda corner: -float(corner @ out))
        edge = corners[1] - corners[0]
        facing = abs(float(edge @ normal)) <= PARALLEL * float(np.hypot(*edge))
        ends.append(corners[: 2 if facing else 1])
    spans = [sorted(float(corner @ across) for corner in side) for side in ends]
    low, high = max(span[0] for span in spans), min(span[-1] for span in spans)
    depth = float(ends[0][0] @ normal)
    return depth * normal + 0.5 * (low + high) * across


def _where(agent: np.ndarray, out: np.ndarray, point: np.ndarray) -> tuple[Side, Part]:
    """Side and part of it, of a point relative to the box's centre.

    out: the direction of the other vehicle
    """
    ahead, left = _axes(agent)
    along, across = float(out @ ahead), float(out @ left)
    if abs(along) >= abs(across):
        share = float(point @ left) / (0.5 * agent[A.WIDTH_M])
        return ("front" if along > 0.0 else "rear"), _part(share, "left", "right")
    share = float(point @ ahead) / (0.5 * agent[A.LENGTH_M])
    return ("left" if across > 0.0 else "right"), _part(share, "front", "rear")


def _part(share: float, above: Part, below: Part) -> Part:
    return above if share > THIRD else below if share < -THIRD else "middle"
