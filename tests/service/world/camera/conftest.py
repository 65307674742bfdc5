"""The scene of I-80, and vehicles on it."""

from __future__ import annotations

import numpy as np
import pytest

from service.world.camera import Camera, Scene, build_scene
from service.world.camera.sheet import traffic
from service.world.scenario.schema import CameraSpec
from sumo_nets.corridor import Corridor


@pytest.fixture(scope="session")
def scene(i80: Corridor) -> Scene:
    return build_scene(i80)


@pytest.fixture(scope="session")
def poses(i80: Corridor) -> np.ndarray:
    """The ego in row 0 at 330 m, a truck, a van and cars ahead of it."""
    return traffic(i80, 330.0)


@pytest.fixture
def camera() -> Camera:
    return Camera(CameraSpec())
