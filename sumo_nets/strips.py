"""The lanes of one edge as strips of road: from the left by where they are drawn, and whom they are for.

SUMO counts lanes from the side that slow traffic keeps to: from the right, or from the left in a network for left-hand
traffic; files of other makers hold either without saying so. The drawn lines alone tell which lane is leftmost.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from sumo_nets.curves import drop_repeats
from sumo_nets.errors import NetworkError

MOTOR_CLASSES = frozenset(
    ("passenger", "private", "hov", "taxi", "bus", "coach", "delivery", "truck", "trailer", "motorcycle", "moped",
     "evehicle", "emergency", "authority", "army", "vip")
)  # fmt: skip
SHORTEST_M = 1e-2  # of a lane's drawn line


def strips(edge: Any, path: Path) -> list[Any]:
    """The lanes (sumolib's) of an edge from the left, without the closed ones at either side of the carriageway.

    NetworkError where a lane cannot be used as it is drawn, and where motor vehicles may use none.
    """
    lanes = edge.getLanes()
    if not lanes:
        raise NetworkError(
            f"{path}: edge {edge.getID()!r} has no lanes; build the network anew with netconvert"
        )
    for lane in lanes:
        _check(lane, path)
    as_sumo = lanes[::-1]  # in right-hand traffic; kept where no lane lies beside another
    lanes = sorted(as_sumo, key=lambda lane: -_aside(as_sumo[0], lane))
    usable = [p for p, lane in enumerate(lanes) if not is_closed(lane)]
    if not usable:
        raise NetworkError(
            f"{path}: no lane of edge {edge.getID()!r} is for motor vehicles; choose other edges, or change allow and "
            "disallow"
        )
    return lanes[usable[0] : usable[-1] + 1]


def is_closed(lane: Any) -> bool:
    """Whether no motor vehicle may use the lane: a sidewalk, a track, a strip that is painted over."""
    return not any(admits(lane, kind) for kind in MOTOR_CLASSES)


def admits(lane: Any, vehicle_class: str) -> bool:
    """Whether a class of vehicles may use the lane; sumolib takes the word "all" for a class of its own."""
    return lane.allows(vehicle_class) or lane.allows("all")


def points_of(lane: Any) -> np.ndarray:
    """The lane's drawn middle line (n, 2) in m."""
    return np.array(lane.getShape(), float)[:, :2]


def _check(lane: Any, path: Path) -> None:
    where = f"{path}: lane {lane.getID()!r}"
    remedy = "build the network anew with netconvert"
    shape = lane.getShape()
    if len(shape) < 2:
        raise NetworkError(f"{where} has a shape of {len(shape)} points, at least 2 are needed; {remedy}")
    points = points_of(lane)
    if not np.isfinite(points).all():
        raise NetworkError(f"{where} has a shape with a point that is no number; {remedy}")
    if len(drop_repeats(points)) < 2 or np.hypot(*np.diff(points, axis=0).T).sum() < SHORTEST_M:
        raise NetworkError(f"{where} has a shape of no length; {remedy}")
    for what, value in (("width", lane.getWidth()), ("length", lane.getLength()), ("speed", lane.getSpeed())):
        if not (np.isfinite(value) and value > 0.0):
            raise NetworkError(f"{where} has {what} {value}; a number above 0 is needed: {remedy}")


def _aside(lane: Any, other: Any) -> float:
    """How far (m) the middle of `other` lies to the left of `lane`, across its direction of travel."""
    (here, direction), (there, _) = _middle(lane), _middle(other)
    apart = there - here
    return round(float(direction[0] * apart[1] - direction[1] * apart[0]), 2)


def _middle(lane: Any) -> tuple[np.ndarray, np.ndarray]:
    """The point half-way along a lane, and its direction there."""
    points = drop_repeats(points_of(lane))
    step = np.diff(points, axis=0)
    length = np.hypot(*step.T)
    along = np.r_[0.0, np.cumsum(length)]
    k = int(np.clip(np.searchsorted(along, along[-1] / 2.0) - 1, 0, len(step) - 1))
    direction = step[k] / length[k]
    return points[k] + (along[-1] / 2.0 - along[k]) * direction, direction
