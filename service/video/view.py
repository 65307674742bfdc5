"""What the ego's camera sees in each state of a trace."""

from dataclasses import dataclass

import msgspec
import numpy as np

from service.camera import Camera, build_scene, poses_of, weather_of
from service.scenario.schema import Scenario
from service.trace import Trace
from sumo_nets.corridor import Corridor


@dataclass(frozen=True)
class EgoView:
    """The camera of the scenario, with the mounting and lens it has there, in any size; x, seed: of the rollout."""

    scenario: Scenario
    corridor: Corridor
    x: np.ndarray
    seed: int

    def pictures(self, trace: Trace, width: int, height: int) -> "Pictures":
        """Pictures (height, width, 3) of the trace's states."""
        spec = msgspec.structs.replace(self.scenario.camera, width_px=width, height_px=height)
        return Pictures(self, trace, Camera(spec))


class Pictures:
    """Pictures of one trace with one camera."""

    def __init__(self, view: EgoView, trace: Trace, camera: Camera):
        self._scene = build_scene(view.corridor)
        self._weather = weather_of(view.scenario, view.x)
        self._seed = view.seed
        self._trace = trace
        self._camera = camera

    def draw(self, k: int) -> np.ndarray:
        """The picture of state k, in OpenCV's order of colours."""
        agents = self._trace.agents[k]
        frame = self._camera.render(
            self._scene,
            poses_of(agents, len(agents)),
            self._trace.ego,
            self._weather,
            seed=self._seed,
            frame=k,
        )
        return frame[:, :, ::-1]
