"""Messages of ego.proto from what the world knows, and answers checked before anything is made of them.

Nothing here touches the network. What an ego service says is input: its size, its kind, its rollout and step, and
every number are checked, and whatever is wrong is an EgoError with a reason.
"""

import math

import cv2
import numpy as np
from google.protobuf.message import DecodeError

from policies import layout
from policies.egos import Observation
from policies.exactmath import sincos
from service.errors import EgoError
from service.world import agents as A
from service.world.egos import ego_pb2 as pb

VERSION = 1
MAX_REPLY_BYTES = 64 * 1024  # an action takes some 60 bytes
MAX_REASON = 500  # characters of a service's own reason that are recorded
# beyond these an answer is a mistake (of a unit, of a sign bit), not a wish to be clipped
MAX_ACCELERATION_MPS2 = 50.0
MAX_TURN_RATE_RADPS = 10.0
MAX_STEERING_RAD = 1.2
WHEELBASE_SHARE = 0.6  # of a car's length: 2.7 m of 4.5 m
JPEG_QUALITY = 95


def observation_of(
    worker: str, rollout: str, step: int, seen: Observation, spacing_m: float
) -> pb.Observation:
    """The message of one observation, without picture and route.

    spacing_m: between stations of the road
    """
    row, v = seen.row, seen.vector.tolist()
    if row is None:
        raise EgoError(
            "an ego over the network needs the ego's row of the world's state with each observation"
        )
    r = row.tolist()
    ego = pb.EgoState(
        x_m=r[A.X_M],
        y_m=r[A.Y_M],
        heading_rad=r[A.HEADING_RAD],
        speed_mps=v[layout.SPEED_MPS],
        acceleration_mps2=r[A.ACCELERATION_MPS2],
        turn_rate_radps=r[A.TURN_RATE_RADPS],
        length_m=v[layout.LENGTH_M],
        width_m=v[layout.WIDTH_M],
        lane=int(r[A.LANE]) + 1,
        station_m=r[A.STATION] * spacing_m + r[A.ALONG_M],
        lane_offset_m=v[layout.LANE_OFFSET_M],
        lane_heading_rad=v[layout.LANE_HEADING_RAD],
        lane_curvature_per_m=v[layout.LANE_CURVATURE_PER_M],
        left_marking_m=v[layout.LEFT_MARKING_M],
        right_marking_m=v[layout.RIGHT_MARKING_M],
        lane_to_the_left=v[layout.LANE_TO_THE_LEFT] != 0.0,
        lane_to_the_right=v[layout.LANE_TO_THE_RIGHT] != 0.0,
        incident=v[layout.INCIDENT] != 0.0,
    )
    lidar = pb.Lidar(
        limit_m=layout.LIDAR_RANGE_M,
        range_m=v[layout.RANGE_M : layout.RANGE_M + layout.BEAMS],
        range_rate_mps=v[layout.RANGE_RATE_MPS : layout.RANGE_RATE_MPS + layout.BEAMS],
    )
    return pb.Observation(worker=worker, rollout=rollout, step=step, time_s=seen.time_s, ego=ego, lidar=lidar)


def vector_of(message: pb.Observation) -> np.ndarray:
    """The 51 values of `policies.layout` that a message carries, to the bit."""
    ego, lidar = message.ego, message.lidar
    core = [
        ego.lane_offset_m, ego.lane_heading_rad, ego.speed_mps, ego.length_m, ego.width_m, ego.lane_curvature_per_m,
        ego.left_marking_m, ego.right_marking_m, ego.lane_to_the_left, ego.lane_to_the_right, ego.incident,
    ]  # fmt: skip
    vector = np.array([*core, *lidar.range_m, *lidar.range_rate_mps], dtype=np.float64)
    if vector.shape != (layout.OBSERVATION_SIZE,):
        raise EgoError(f"an observation has {layout.OBSERVATION_SIZE} values, not {vector.size}")
    return vector


def picture_of(frame: np.ndarray, encoding: int) -> pb.Picture:
    """The message of a picture (height, width, 3) uint8 RGB, as the service asked for it."""
    height, width = frame.shape[:2]
    if encoding == pb.CAMERA_RAW:
        data = frame.tobytes()
    else:
        good, packed = cv2.imencode(
            ".jpg", cv2.cvtColor(frame, cv2.COLOR_RGB2BGR), [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY]
        )
        if not good:
            raise EgoError(f"a picture of {width} x {height} cannot be packed as JPEG")
        data = packed.tobytes()
    return pb.Picture(encoding=pb.Camera.Name(encoding), width=width, height=height, data=data)


def frame_of(picture: pb.Picture) -> np.ndarray:
    """The picture (height, width, 3) uint8 RGB of a message; EgoError where it is not one."""
    shape = (picture.height, picture.width, 3)
    if picture.encoding == pb.CAMERA_RAW:
        if len(picture.data) != shape[0] * shape[1] * 3:
            raise EgoError(f"a raw picture of {shape[1]} x {shape[0]} has {len(picture.data)} bytes")
        return np.frombuffer(picture.data, np.uint8).reshape(shape)
    found = cv2.imdecode(np.frombuffer(picture.data, np.uint8), cv2.IMREAD_COLOR) if picture.data else None
    if found is None or found.shape != shape:
        raise EgoError(f"no JPEG picture of {shape[1]} x {shape[0]}")
    return cv2.cvtColor(found, cv2.COLOR_BGR2RGB)


def reply_of(payload: bytes, wanted: str, most_bytes: int = MAX_REPLY_BYTES) -> pb.Reply:
    """The reply in `payload`, of kind `wanted`; EgoError for anything else, a refusal's own reason included."""
    if len(payload) > most_bytes:
        raise EgoError(f"the answer has {len(payload)} bytes; at most {most_bytes} are taken")
    try:
        reply = pb.Reply.FromString(payload)
    except DecodeError as error:
        raise EgoError(f"the answer of {len(payload)} bytes is not a Reply of ego.proto: {error}") from error
    kind = reply.WhichOneof("kind")
    if kind == "refusal":
        raise EgoError(f"the service refused: {shown(reply.refusal.reason)}")
    if kind != wanted:
        raise EgoError(f"the answer is {kind or 'empty'} where {wanted} was due")
    return reply


def action_of(
    action: pb.Action, rollout: str, step: int, speed_mps: float, length_m: float
) -> tuple[float, float]:
    """Acceleration (m/s^2) and turn rate (rad/s) of an answer; EgoError for one that is of another rollout or step, not
    finite or out of range.

    Pedals: a throttle in [-1, 1] is that share of the hardest acceleration or braking; front wheels at `steering_rad`
    turn a car of wheelbase L at v tan(steering) / L (kinematic bicycle model).
    """
    if action.rollout != rollout or action.step != step:
        raise EgoError(
            f"the answer is for step {action.step} of rollout {shown(action.rollout)!r}, not step {step} of {rollout!r}"
        )
    control = action.WhichOneof("control")
    if control == "motion":
        acceleration = _within(action.motion.acceleration_mps2, MAX_ACCELERATION_MPS2, "acceleration_mps2")
        return acceleration, _within(action.motion.turn_rate_radps, MAX_TURN_RATE_RADPS, "turn_rate_radps")
    if control == "pedals":
        throttle = _within(action.pedals.throttle, 1.0, "throttle")
        steering = _within(action.pedals.steering_rad, MAX_STEERING_RAD, "steering_rad")
        hardest = layout.MAX_ACCELERATION_MPS2 if throttle >= 0.0 else layout.MAX_DECELERATION_MPS2
        sine, cosine = sincos(steering)
        return throttle * hardest, speed_mps * (sine / cosine) / (WHEELBASE_SHARE * length_m)
    raise EgoError("the answer has neither motion nor pedals")


def shown(text: str) -> str:
    """Text of a stranger as one line of bounded length."""
    line = "".join(c if c.isprintable() else "?" for c in text[:MAX_REASON])
    return line + ("..." if len(text) > MAX_REASON else "")


def _within(value: float, limit: float, name: str) -> float:
    if not math.isfinite(value):
        raise EgoError(f"the answer's {name} is {value}")
    if abs(value) > limit:
        raise EgoError(f"the answer's {name} is {value:g}, beyond {limit:g} either way")
    return value
