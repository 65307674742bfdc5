"""The ego `zenoh:NAME`: a black box that answers observations with actions, in lockstep, before a deadline.

    hello -> welcome      once: the protocol's version, which of the services there are, what it wants to see
    reset -> ready        every rollout
    observation -> action every step

Anything else (no answer in time, no service, another rollout's answer, NaN, ...) raises EgoError, which the simulator
records as that rollout's error; the next rollout begins with a reset as if nothing had been.
"""

import numpy as np

from policies.egos import Observation
from service.errors import EgoError
from service.world import agents as A
from service.world.egos import ego_pb2 as pb
from service.world.egos import messages
from service.world.egos.link import ZenohLine
from service.world.egos.peer import OpenLine, Peer
from service.world.egos.settings import EgoSettings
from service.world.sim.projection import REF_COS, REF_SIN, REF_X, REF_Y
from service.world.sim.road import Road

ROUTE_STEP_M = 5.0
ROUTE_POINTS = 20  # 100 m, as far as the lidar sees


class RemoteEgo:
    """An ego policy whose every decision is made by a service on the network."""

    def __init__(
        self,
        name: str,
        settings: EgoSettings,
        road: Road,
        scenario: str,
        step_s: float,
        open_line: OpenLine = ZenohLine,
    ):
        """Prepare an ego that is a service; nothing is connected before it is needed.

        name: the service's, without `zenoh:`
        """
        self.name = f"zenoh:{name}"
        self._peer = Peer(name, settings, scenario, step_s, open_line)
        self._road = road
        self._rollouts = 0
        self._rollout = ""
        self._step = 0

    @property
    def wants_camera(self) -> bool:
        """Whether the service asked for pictures; False before it was met."""
        welcome = self._peer.welcome
        return welcome is not None and welcome.camera != pb.CAMERA_NONE

    def greet(self) -> pb.Welcome:
        """The service's welcome; EgoError where there is no service or none that speaks our version."""
        return self._peer.greet()

    def reset(self, seed: int) -> None:
        self._rollouts += 1
        self._rollout = f"{self._peer.worker}-{self._rollouts}"
        self._step = 0
        reset = pb.Reset(worker=self._peer.worker, rollout=self._rollout, seed=seed)
        ready = self._peer.ask(pb.Request(reset=reset), "ready").ready
        if ready.rollout != self._rollout:
            raise EgoError(
                f"ego service {self._peer.name!r} is ready for rollout {messages.shown(ready.rollout)!r}, not for "
                f"{self._rollout!r}"
            )

    def act(self, observation: Observation) -> tuple[float, float]:
        welcome = self._peer.welcome
        if welcome is None:
            raise EgoError(f"ego service {self._peer.name!r} was not reset")
        message = messages.observation_of(
            self._peer.worker, self._rollout, self._step, observation, self._road.spacing_m
        )
        if welcome.camera != pb.CAMERA_NONE:
            if observation.frame is None:
                raise EgoError(f"ego service {self._peer.name!r} wants pictures, but there is no camera")
            message.picture.CopyFrom(messages.picture_of(observation.frame, welcome.camera))
        if welcome.route and observation.row is not None:
            message.route.CopyFrom(route_ahead(self._road, observation.row))
        reply = self._peer.ask(pb.Request(observation=message), "action")
        ego = message.ego
        action = messages.action_of(reply.action, self._rollout, self._step, ego.speed_mps, ego.length_m)
        self._step += 1
        return action

    def close(self) -> None:
        """Say goodbye, so that the service can forget this worker."""
        self._peer.close()


def route_ahead(road: Road, row: np.ndarray) -> pb.Route:
    """The centre of the ego's lane over the next 100 m, in the ego's axes; it ends where the lane or the road does."""
    lane = int(row[A.LANE])
    first = row[A.STATION] * road.spacing_m + row[A.ALONG_M]
    wanted = np.round((first + ROUTE_STEP_M * np.arange(1, ROUTE_POINTS + 1)) / road.spacing_m).astype(int)
    stations = wanted[wanted < len(road.reference)]
    centre = road.lanes[stations, lane, :2].mean(axis=1)
    ends = np.flatnonzero(np.isnan(centre))
    if ends.size:
        stations, centre = stations[: ends[0]], centre[: ends[0]]
    reference = road.reference[stations]
    dx = reference[:, REF_X] - centre * reference[:, REF_SIN] - row[A.X_M]
    dy = reference[:, REF_Y] + centre * reference[:, REF_COS] - row[A.Y_M]
    return pb.Route(
        x_m=(dx * row[A.COS] + dy * row[A.SIN]).tolist(), y_m=(dy * row[A.COS] - dx * row[A.SIN]).tolist()
    )
