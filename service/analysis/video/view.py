"""What the ego's camera sees in each state of a trace."""

from collections.abc import Iterator
from dataclasses import dataclass

import cv2
import msgspec
import numpy as np

from service.analysis.trace import Trace
from service.errors import SimulationError
from service.world.camera import Camera, build_scene, poses_of, weather_of
from service.world.scenario.schema import Scenario
from sumo_nets.corridor import Corridor

QUALITY = 80  # of JPEG, in percent


@dataclass(frozen=True)
class EgoView:
    """The camera of the scenario, with the mounting and lens it has there, in any size.

    x, seed: of the rollout
    """

    scenario: Scenario
    corridor: Corridor
    x: np.ndarray
    seed: int

    def pictures(self, trace: Trace, width: int, height: int) -> "Pictures":
        """Pictures (height, width, 3) of the trace's states."""
        spec = msgspec.structs.replace(self.scenario.camera, width_px=width, height_px=height)
        return Pictures(self, trace, Camera(spec))


def jpeg_pictures(view: EgoView, trace: Trace, count: int, width: int) -> Iterator[tuple[int, bytes]]:
    """At most `count` states, evenly over the trace, and what the camera sees in each as JPEG; `width` pixels wide, the
    scenario's shape."""
    spec = view.scenario.camera
    height = max(round(width * spec.height_px / spec.width_px), 1)
    pictures = view.pictures(trace, width, height)
    states = np.unique(
        np.linspace(0, len(trace.time_s) - 1, min(count, len(trace.time_s))).round().astype(int)
    )
    for k in states.tolist():
        good, data = cv2.imencode(".jpg", pictures.draw(k), [cv2.IMWRITE_JPEG_QUALITY, QUALITY])
        if not good:
            raise SimulationError("OpenCV cannot write JPEG pictures")
        yield k, data.tobytes()


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
