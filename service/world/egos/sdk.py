"""Serve a driving policy to tailroad's workers, in a few lines of Python:

    from service.world.egos.sdk import serve

    class Careful:
        def reset(self, seed): ...
        def act(self, observation):
            return -1.0 if observation.lidar.range_m[0] < 30.0 else 0.5, 0.0

    serve(Careful, "careful")         # tailroad rollout i80-10s --ego zenoh:careful

`act` answers acceleration (m/s^2) and turn rate (rad/s), or `Pedals(steering_rad, throttle)`. The class is made anew
for each worker that calls; a worker runs one rollout at a time. Any policy of `policies.egos` can be served as it is.
"""

import contextlib
import uuid
from collections import OrderedDict
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

from google.protobuf.message import DecodeError

from policies.egos import Observation
from service.errors import EgoError, InputError
from service.world.egos import ego_pb2 as pb
from service.world.egos import messages
from service.world.egos.listening import Listening

MAX_WORKERS = 1024  # sessions kept; beyond, the longest idle is forgotten
CAMERAS = {None: pb.CAMERA_NONE, "raw": pb.CAMERA_RAW, "jpeg": pb.CAMERA_JPEG}


class Pedals(NamedTuple):
    """An answer of front-wheel angle (rad, positive to the left) and throttle (1 full, -1 full brake)."""

    steering_rad: float
    throttle: float


@dataclass(slots=True)
class Seen(Observation):
    """An observation with the whole message it came in: ego, lidar, picture, route."""

    message: pb.Observation | None = None

    @property
    def ego(self) -> pb.EgoState:
        assert self.message is not None
        return self.message.ego

    @property
    def lidar(self) -> pb.Lidar:
        assert self.message is not None
        return self.message.lidar

    @property
    def route(self) -> pb.Route:
        assert self.message is not None
        return self.message.route


class Answering:
    """What a service answers: requests in, replies out, no network."""

    def __init__(self, make_ego: Callable[[], Any], camera: str | None = None, route: bool = False):
        if camera not in CAMERAS:
            raise InputError(f"camera={camera!r}: give None, 'raw' or 'jpeg'")
        self.instance = uuid.uuid4().hex
        self._make_ego = make_ego
        self._camera = CAMERAS[camera]
        self._route = route
        self._egos: OrderedDict[str, Any] = OrderedDict()

    def answer(self, payloads: Sequence[bytes]) -> list[pb.Reply | None]:
        """The replies to requests that wait now; None where none is due.

        An ego class that has `act_batch` is given all observations that wait, of different workers, in one call
        `act_batch([(ego, observation), ...])` and answers an action for each, or an exception for one that has none.
        """
        replies: list[pb.Reply | None] = [None] * len(payloads)
        together: list[tuple[int, Any, Seen]] = []
        for i, payload in enumerate(payloads):
            try:
                request = pb.Request.FromString(payload)
                if request.WhichOneof("kind") == "observation":
                    together.append((i, *self._seen(request.observation)))
                else:
                    replies[i] = self._answer(request)
            except DecodeError:
                replies[i] = refusal("not a Request of ego.proto")
            except (
                Exception
            ) as error:  # whatever the policy raises is told to the worker, and the service goes on
                replies[i] = _error_reply(error)
        for (i, _, seen), action in zip(together, self._act(together), strict=True):
            replies[i] = action if isinstance(action, pb.Reply) else reply_to(seen, action)
        return replies

    def _answer(self, request: pb.Request) -> pb.Reply | None:
        kind = request.WhichOneof("kind")
        if kind == "hello":
            if request.hello.version != messages.VERSION:
                return refusal(f"speaks version {messages.VERSION} of ego.proto, not {request.hello.version}")
            return pb.Reply(
                welcome=pb.Welcome(
                    version=messages.VERSION,
                    instance=self.instance,
                    sessions=len(self._egos),
                    camera=pb.Camera.Name(self._camera),
                    route=self._route,
                )
            )
        if kind == "reset":
            self._ego(request.reset.worker).reset(request.reset.seed)
            return pb.Reply(ready=pb.Ready(rollout=request.reset.rollout))
        if kind == "goodbye":
            self._egos.pop(request.goodbye.worker, None)
            return None
        return refusal("an empty request")

    def _ego(self, worker: str) -> Any:
        if worker not in self._egos:
            self._egos[worker] = self._make_ego()
            while len(self._egos) > MAX_WORKERS:
                self._egos.popitem(last=False)
        self._egos.move_to_end(worker)
        return self._egos[worker]

    def _seen(self, message: pb.Observation) -> tuple[Any, Seen]:
        if message.worker not in self._egos:
            raise EgoError("an observation before a reset")
        frame = messages.frame_of(message.picture) if message.HasField("picture") else None
        return self._ego(message.worker), Seen(
            messages.vector_of(message), message.time_s, frame=frame, message=message
        )

    def _act(self, together: list[tuple[int, Any, Seen]]) -> list[Any]:
        """An action or a refusal for each."""
        batched = getattr(type(together[0][1]), "act_batch", None) if together else None
        if batched is not None:
            try:
                actions = list(batched([(ego, seen) for _, ego, seen in together]))
                if len(actions) != len(together):
                    raise EgoError(f"act_batch gave {len(actions)} actions for {len(together)} observations")
            except Exception as error:
                return [_error_reply(error)] * len(together)
            return [_error_reply(action) if isinstance(action, Exception) else action for action in actions]
        return [_one(ego, seen) for _, ego, seen in together]


def _one(ego: Any, seen: Seen) -> Any:
    try:
        return ego.act(seen)
    except Exception as error:
        return _error_reply(error)


def _error_reply(error: Exception) -> pb.Reply:
    return refusal(f"{type(error).__name__}: {error}")


def reply_to(seen: Seen, action: Any) -> pb.Reply:
    """The reply that carries a policy's answer; a refusal where it is not one."""
    message = seen.message
    assert message is not None
    try:
        if isinstance(action, Pedals):
            pedals = pb.Pedals(steering_rad=action.steering_rad, throttle=action.throttle)
            return pb.Reply(action=pb.Action(rollout=message.rollout, step=message.step, pedals=pedals))
        acceleration, turn_rate = action
        motion = pb.Motion(acceleration_mps2=acceleration, turn_rate_radps=turn_rate)
        return pb.Reply(action=pb.Action(rollout=message.rollout, step=message.step, motion=motion))
    except (TypeError, ValueError) as error:
        return refusal(f"the policy answered {action!r}: {error}")


def refusal(reason: str) -> pb.Reply:
    return pb.Reply(refusal=pb.Refusal(reason=messages.shown(reason)))


class Service(Listening):
    """An ego service on the network; use as a context manager. See `serve` for the arguments."""

    def __init__(
        self,
        make_ego: Callable[[], Any],
        name: str,
        *,
        camera: str | None = None,
        route: bool = False,
        **where: str | None,
    ):
        super().__init__(Answering(make_ego, camera, route), name, **where)


def serve(make_ego: Callable[[], Any], name: str, **options: Any) -> None:
    """Answer workers until interrupted.

    make_ego: called for each worker; a class will do

    Options: listen: an address that workers connect to, loopback by default. connect: a Zenoh router to go through
    instead. camera: None, "raw" or "jpeg". route: whether the lane ahead is wanted. config: a Zenoh configuration
    file in place of the addresses (TLS, access control).
    """
    with Service(make_ego, name, **options) as service, contextlib.suppress(KeyboardInterrupt):
        print(f"ego service {name!r} is ready", flush=True)
        service.run()
