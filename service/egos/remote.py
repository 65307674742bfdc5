"""The ego `zenoh:NAME`: a black box that answers observations with actions, in lockstep, before a deadline.

    hello -> welcome      once: the protocol's version, which of the services there are, what it wants to see
    reset -> ready        every rollout
    observation -> action every step

Anything else (no answer in time, no service, another rollout's answer, NaN, ...) raises EgoError, which the simulator
records as that rollout's error; the next rollout begins with a reset as if nothing had been.
"""

import uuid
from collections.abc import Callable

import numpy as np

from policies.egos import Observation
from service import agents as A
from service.egos import ego_pb2 as pb
from service.egos import messages
from service.egos.link import Line, ZenohLine
from service.egos.settings import EgoSettings
from service.errors import EgoError
from service.sim.projection import REF_COS, REF_SIN, REF_X, REF_Y
from service.sim.road import Road

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
        open_line: Callable[[EgoSettings, float], Line] = ZenohLine,
    ):
        """name: the service's, without `zenoh:`. The line is opened when it is first needed."""
        self.name = f"zenoh:{name}"
        self._service_name = name
        self._settings = settings
        self._road = road
        self._scenario = scenario
        self._step_s = step_s
        self._worker = uuid.uuid4().hex
        self._rollouts = 0
        self._rollout = ""
        self._step = 0
        self._welcome: pb.Welcome | None = None
        self._patience_s = settings.patience_s
        self._open_line = open_line
        self._opened: Line | None = None

    @property
    def wants_camera(self) -> bool:
        """Whether the service asked for pictures; False before it was met."""
        return self._welcome is not None and self._welcome.camera != pb.CAMERA_NONE

    def greet(self) -> pb.Welcome:
        """The service's welcome; EgoError where there is no service or none that speaks our version."""
        if self._welcome is None:
            self._welcome = self._hello()
        return self._welcome

    def reset(self, seed: int) -> None:
        welcome = self.greet()
        self._rollouts += 1
        self._rollout = f"{self._worker}-{self._rollouts}"
        self._step = 0
        request = pb.Request(reset=pb.Reset(worker=self._worker, rollout=self._rollout, seed=seed))
        ready = messages.reply_of(self._ask(welcome, request), "ready").ready
        if ready.rollout != self._rollout:
            raise EgoError(
                f"ego service {self._service_name!r} is ready for rollout {messages.shown(ready.rollout)!r}, not for "
                f"{self._rollout!r}"
            )

    def act(self, observation: Observation) -> tuple[float, float]:
        welcome = self._welcome
        if welcome is None:
            raise EgoError(f"ego service {self._service_name!r} was not reset")
        message = messages.observation_of(
            self._worker, self._rollout, self._step, observation, self._road.spacing_m
        )
        if welcome.camera != pb.CAMERA_NONE:
            if observation.frame is None:
                raise EgoError(f"ego service {self._service_name!r} wants pictures, but there is no camera")
            message.picture.CopyFrom(messages.picture_of(observation.frame, welcome.camera))
        if welcome.route and observation.row is not None:
            message.route.CopyFrom(route_ahead(self._road, observation.row))
        reply = messages.reply_of(self._ask(welcome, pb.Request(observation=message)), "action")
        ego = message.ego
        action = messages.action_of(reply.action, self._rollout, self._step, ego.speed_mps, ego.length_m)
        self._step += 1
        return action

    def close(self) -> None:
        """Say goodbye, so that the service can forget this worker."""
        if self._welcome is not None:
            goodbye = pb.Request(goodbye=pb.Goodbye(worker=self._worker))
            self._line().tell(self._service_name, self._welcome.instance, goodbye.SerializeToString())
        if self._opened is not None:
            self._opened.close()
            self._opened = self._welcome = None

    def _line(self) -> Line:
        if self._opened is None:
            try:
                self._opened = self._open_line(self._settings, self._patience_s)
            except EgoError:
                self._patience_s = 0.0
                raise
        return self._opened

    def _hello(self) -> pb.Welcome:
        """Greet all services of the name and take the one with the fewest workers.

        A service that is missing is waited for, but only once: after a wait in vain the next rollouts fail at once,
        until a service is back.
        """
        if not self._line().wait(self._service_name, self._patience_s):
            self._patience_s = 0.0
            raise EgoError(f"there is no ego service {self._service_name!r} at {self._settings.address}")
        hello = pb.Hello(
            version=messages.VERSION,
            worker=self._worker,
            scenario=self._scenario,
            step_s=self._step_s,
            deadline_s=self._settings.deadline_s,
        )
        payload = pb.Request(hello=hello).SerializeToString()
        welcomes, reasons = [], []
        for answer in self._line().ask_all(self._service_name, payload, self._settings.patience_s):
            try:
                welcomes.append(_checked(messages.reply_of(answer, "welcome").welcome))
            except EgoError as error:
                reasons.append(str(error))
        if not welcomes:
            self._patience_s = 0.0
            why = reasons[0] if reasons else "it does not answer"
            raise EgoError(f"no handshake with ego service {self._service_name!r}: {why}")
        self._patience_s = self._settings.patience_s
        return min(welcomes, key=lambda w: (w.sessions, w.instance))

    def _ask(self, welcome: pb.Welcome, request: pb.Request) -> bytes:
        try:
            return self._line().ask(self._service_name, welcome.instance, request.SerializeToString())
        except EgoError:
            self._welcome = None  # late or gone: the next rollout looks for a service anew
            raise


def _checked(welcome: pb.Welcome) -> pb.Welcome:
    if welcome.version != messages.VERSION:
        raise EgoError(
            f"it speaks version {welcome.version} of ego.proto; this worker speaks {messages.VERSION}"
        )
    if not (welcome.instance.isalnum() and welcome.instance.isascii() and len(welcome.instance) <= 64):
        raise EgoError(f"its instance {messages.shown(welcome.instance)!r} is not 1 to 64 letters and digits")
    if welcome.camera not in (pb.CAMERA_NONE, pb.CAMERA_RAW, pb.CAMERA_JPEG):
        raise EgoError(f"it wants pictures of an unknown kind {welcome.camera}")
    return welcome


def route_ahead(road: Road, row: np.ndarray) -> pb.Route:
    """The centre of the ego's lane over the next 100 m, in the ego's axes; it ends where the lane or the road does."""
    lane = int(row[A.LANE])
    first = row[A.STATION] * road.spacing_m + row[A.ALONG_M]
    wanted = np.round((first + ROUTE_STEP_M * np.arange(1, ROUTE_POINTS + 1)) / road.spacing_m).astype(int)
    stations = wanted[wanted < len(road.reference)]
    centre = road.lanes[stations, lane].mean(axis=1)
    ends = np.flatnonzero(np.isnan(centre))
    if ends.size:
        stations, centre = stations[: ends[0]], centre[: ends[0]]
    reference = road.reference[stations]
    dx = reference[:, REF_X] - centre * reference[:, REF_SIN] - row[A.X_M]
    dy = reference[:, REF_Y] + centre * reference[:, REF_COS] - row[A.Y_M]
    return pb.Route(
        x_m=(dx * row[A.COS] + dy * row[A.SIN]).tolist(), y_m=(dy * row[A.COS] - dx * row[A.SIN]).tolist()
    )
