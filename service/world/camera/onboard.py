"""The ego's camera during a rollout: its weather drawn with x, its noise from the rollout's seed."""

import numpy as np

from service.world.camera.poses import poses_of
from service.world.camera.render import Camera
from service.world.camera.scene import build_scene
from service.world.camera.weather import weather_of
from service.world.scenario.schema import Scenario
from sumo_nets.corridor import Corridor


class OnboardCamera:
    """Takes a picture a step; use `begin` before each rollout."""

    def __init__(self, scenario: Scenario, corridor: Corridor):
        self._scenario = scenario
        self._scene = build_scene(corridor)
        self._camera = Camera(scenario.camera)

    def begin(self, x: np.ndarray, seed: int) -> None:
        """A new rollout of the draw x (d,) with this noise seed."""
        self._weather, self._seed = weather_of(self._scenario, x), seed

    def picture(self, agents: np.ndarray, count: int, ego: int, step: int) -> np.ndarray:
        """What the vehicle in row `ego` sees before `step`: (h, w, 3) uint8 RGB."""
        poses = poses_of(agents, count)
        return self._camera.render(self._scene, poses, ego, self._weather, self._seed, step)
