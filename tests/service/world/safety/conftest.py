"""Vehicles on a straight road, as the world holds them."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from service.world import agents as A

LENGTH, WIDTH = 4.5, 1.8


def vehicles(*rows: tuple[float, ...]) -> np.ndarray:
    """Agents from (x, y, heading, speed) or (x, y, heading, speed, length, width), on a road along the x axis."""
    agents = np.zeros((len(rows), A.COLUMNS))
    for agent, row in zip(agents, rows, strict=True):
        x, y, heading, speed, length, width = (*row, LENGTH, WIDTH)[:6]
        agent[[A.X_M, A.Y_M, A.HEADING_RAD, A.SPEED_MPS]] = x, y, heading, speed
        agent[[A.LENGTH_M, A.WIDTH_M]] = length, width
        agent[[A.COS, A.SIN]] = np.cos(heading), np.sin(heading)
        agent[A.LANE_HEADING_RAD] = heading
    agents[:, A.ACTIVE] = 1.0
    return agents


def corners(x: float, y: float, heading: float, length: float, width: float) -> np.ndarray:
    """Corners (4, 2) of a box."""
    c, s = np.cos(heading), np.sin(heading)
    body = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]]) * (length / 2, width / 2)
    return body @ np.array([[c, s], [-s, c]]) + (x, y)


@pytest.fixture(scope="session")
def agents_of() -> Callable[..., np.ndarray]:
    return vehicles


@pytest.fixture(scope="session")
def corners_of() -> Callable[..., np.ndarray]:
    return corners
