"""The ego's camera where the pictures are made elsewhere: physics here, the renderer in another process or machine."""

from dataclasses import replace

import numpy as np

from service.errors import EgoError
from service.world.camera.poses import poses_of
from service.world.egos import ego_pb2 as pb
from service.world.egos.link import ZenohLine
from service.world.egos.messages import frame_of
from service.world.egos.peer import OpenLine, Peer
from service.world.egos.settings import EgoSettings
from service.world.scenario.base import weather_values
from service.world.scenario.load import digest
from service.world.scenario.schema import Scenario

RENDERER = "renderer"  # the name that renderers serve under
OVERHEAD_BYTES = 1000  # of a picture's message beside its pixels


class RemoteCamera:
    """Stands in for `service.world.camera.onboard.OnboardCamera`; its pictures have the same bits."""

    def __init__(self, scenario: Scenario, settings: EgoSettings, open_line: OpenLine = ZenohLine):
        assert settings.renderer is not None
        there = replace(settings, address=settings.renderer)
        self._peer = Peer(RENDERER, there, scenario.name, scenario.time.step_s, open_line)
        self._scenario = scenario
        self._digest = digest(scenario)
        self._shape = (scenario.camera.height_px, scenario.camera.width_px, 3)
        self._weather: list[float] = []
        self._seed = 0

    def begin(self, x: np.ndarray, seed: int) -> None:
        """A new rollout of the draw x (d,) with this noise seed."""
        self._weather = list(weather_values(self._scenario, x).values())
        self._seed = seed

    def picture(self, agents: np.ndarray, count: int, ego: int, step: int) -> np.ndarray:
        """What the vehicle in row `ego` sees before `step`: (h, w, 3) uint8 RGB; EgoError where none comes in time."""
        render = pb.Render(
            worker=self._peer.worker,
            scenario=self._digest,
            seed=self._seed,
            frame=step,
            ego=ego,
            pose=poses_of(agents, count).ravel().tolist(),
            weather=self._weather,
        )
        most = int(np.prod(self._shape)) + OVERHEAD_BYTES
        frame = frame_of(self._peer.ask(pb.Request(render=render), "picture", most).picture)
        if frame.shape != self._shape:
            raise EgoError(
                f"the renderer's picture is {frame.shape[1]} x {frame.shape[0]}, not as the scenario says"
            )
        return frame

    def close(self) -> None:
        self._peer.close()
