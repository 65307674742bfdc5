"""A rollout as an MCAP recording that Foxglove and other viewers of robot logs open.

    /scene      foxglove.SceneUpdate     the vehicles as boxes with their names
    /road       foxglove.SceneUpdate     lane markings and edges around the ego's path, once
    /tf         foxglove.FrameTransform  where the ego is, so that a viewer can follow it
    /lidar      foxglove.LaserScan       ranges of the ego's rays, in its own frame
    /ego        JSON                     time to collision, speed and actions, for plots

The map's origin is where the ego starts, x to the east, y to the north, in metres; the log's clock starts at 0.
Vehicles are boxes of HEIGHT_M: the world is flat, and heights are for the eye.
"""

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
from foxglove_schemas_protobuf.Color_pb2 import Color
from foxglove_schemas_protobuf.CubePrimitive_pb2 import CubePrimitive
from foxglove_schemas_protobuf.FrameTransform_pb2 import FrameTransform
from foxglove_schemas_protobuf.LaserScan_pb2 import LaserScan
from foxglove_schemas_protobuf.LinePrimitive_pb2 import LinePrimitive
from foxglove_schemas_protobuf.Point3_pb2 import Point3
from foxglove_schemas_protobuf.Pose_pb2 import Pose
from foxglove_schemas_protobuf.Quaternion_pb2 import Quaternion
from foxglove_schemas_protobuf.SceneEntity_pb2 import SceneEntity
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate
from foxglove_schemas_protobuf.TextPrimitive_pb2 import TextPrimitive
from foxglove_schemas_protobuf.Vector3_pb2 import Vector3
from google.protobuf.message import Message
from google.protobuf.timestamp_pb2 import Timestamp
from mcap.writer import Writer
from mcap_protobuf.schema import register_schema

from service.analysis.trace import Trace
from service.errors import InputError
from service.world import agents as A
from service.world.sensors.lidar import beam_directions, scan
from sumo_nets.corridor import Corridor

MAP, EGO = "map", "ego"  # frames
HEIGHT_M = 1.5
ROAD_MARGIN_M = 100.0  # road drawn before and after the ego's path
LIDAR_RANGE_M = 100.0
EGO_COLOUR, DANGER_COLOUR, OTHER_COLOUR, TAKEN_OVER_COLOUR = (
    Color(r=0.12, g=0.51, b=0.84, a=1.0),
    Color(r=0.90, g=0.24, b=0.24, a=1.0),
    Color(r=0.75, g=0.75, b=0.75, a=1.0),
    Color(r=0.67, g=0.47, b=0.59, a=1.0),
)
LINE_COLOUR = Color(r=0.9, g=0.9, b=0.9, a=1.0)
EGO_SCHEMA: dict[str, Any] = {
    "title": "tailroad.Ego",
    "type": "object",
    "properties": {
        name: {"type": ["number", "null"]}
        for name in ("time_s", "ttc_s", "speed_mps", "acceleration_mps2", "turn_rate_radps", "station_m")
    },
}


def write_recording(
    trace: Trace,
    corridor: Corridor,
    path: Path,
    gamma: float,
    rays: int,
    attached: dict[str, str] | None = None,
) -> None:
    """Write the recording (.mcap).

    gamma: the ego is red while its time to collision is not above it
    rays: of the safety measure
    attached: texts to go with it, by file name
    """
    if path.suffix.lower() != ".mcap":
        raise InputError(f"--recording {path}: recordings are written as .mcap; give a name that ends so")
    with path.open("wb") as out:
        log = _Log(Writer(out))
        origin = trace.agents[0, trace.ego, [A.X_M, A.Y_M]]
        log.write("/road", _road(trace, corridor, origin), 0.0)
        for k, time_s in enumerate(trace.time_s.tolist()):
            log.write("/scene", _scene(trace, k, origin, gamma), time_s)
            log.write("/tf", _transform(trace, k, origin), time_s)
            log.write("/lidar", _lidar(trace, k, rays), time_s)
            log.write_json("/ego", _ego(trace, k), time_s)
        for name, text in (attached or {}).items():
            log.writer.add_attachment(0, 0, name, "text/plain", text.encode())
        log.writer.finish()


class _Log:
    """Channels by topic, made when first written to."""

    def __init__(self, writer: Writer):
        self.writer = writer
        self._channels: dict[str, int] = {}
        writer.start(library="tailroad")

    def write(self, topic: str, message: Message, time_s: float) -> None:
        if topic not in self._channels:
            schema = register_schema(self.writer, type(message))
            self._channels[topic] = self.writer.register_channel(topic, "protobuf", schema)
        self._add(topic, message.SerializeToString(deterministic=True), time_s)

    def write_json(self, topic: str, values: dict[str, Any], time_s: float) -> None:
        if topic not in self._channels:
            schema = self.writer.register_schema(
                EGO_SCHEMA["title"], "jsonschema", json.dumps(EGO_SCHEMA).encode()
            )
            self._channels[topic] = self.writer.register_channel(topic, "json", schema)
        self._add(topic, json.dumps(values).encode(), time_s)

    def _add(self, topic: str, data: bytes, time_s: float) -> None:
        at = _nanoseconds(time_s)
        self.writer.add_message(self._channels[topic], at, data, at)


def _nanoseconds(time_s: float) -> int:
    return round(time_s * 1e9)


def _timestamp(time_s: float) -> Timestamp:
    seconds, rest = divmod(_nanoseconds(time_s), 10**9)
    return Timestamp(seconds=seconds, nanos=rest)


def _pose(x: float, y: float, z: float, heading_rad: float) -> Pose:
    half = 0.5 * heading_rad
    return Pose(position=Vector3(x=x, y=y, z=z), orientation=Quaternion(z=math.sin(half), w=math.cos(half)))


def _scene(trace: Trace, k: int, origin: np.ndarray, gamma: float) -> SceneUpdate:
    update = SceneUpdate()
    at = _timestamp(float(trace.time_s[k]))
    for i, name in enumerate(trace.names):
        agent = trace.agents[k, i]
        if agent[A.ACTIVE] == 0.0:
            continue
        x, y = (agent[[A.X_M, A.Y_M]] - origin).tolist()
        if i == trace.ego:
            colour = DANGER_COLOUR if trace.ttc_s[k] <= gamma or agent[A.COLLISION] else EGO_COLOUR
        else:
            colour = TAKEN_OVER_COLOUR if agent[A.TAKEN_OVER] else OTHER_COLOUR
        box = CubePrimitive(
            pose=_pose(x, y, 0.5 * HEIGHT_M, float(agent[A.HEADING_RAD])),
            size=Vector3(x=float(agent[A.LENGTH_M]), y=float(agent[A.WIDTH_M]), z=HEIGHT_M),
            color=colour,
        )
        label = TextPrimitive(
            pose=_pose(x, y, 1.6 * HEIGHT_M, 0.0), billboard=True, font_size=1.0, text=name, color=LINE_COLOUR
        )
        update.entities.append(
            SceneEntity(timestamp=at, frame_id=MAP, id=f"vehicle/{name}", cubes=[box], texts=[label])
        )
    gone = [n for i, n in enumerate(trace.names) if trace.agents[k, i, A.ACTIVE] == 0.0]
    for name in gone:
        update.deletions.add(timestamp=at, id=f"vehicle/{name}")
    return update


def _road(trace: Trace, corridor: Corridor, origin: np.ndarray) -> SceneUpdate:
    """Lane markings and road edges as lines, along the ego's path."""
    station = trace.station_m[:, trace.ego]
    near = (corridor.station_m >= station.min() - ROAD_MARGIN_M) & (
        corridor.station_m <= station.max() + ROAD_MARGIN_M
    )
    normal = np.column_stack([-np.sin(corridor.ref_heading[near]), np.cos(corridor.ref_heading[near])])
    centre = np.column_stack([corridor.ref_x[near], corridor.ref_y[near]]) - origin
    entity = SceneEntity(timestamp=_timestamp(0.0), frame_id=MAP, id="road")
    borders = [corridor.road_left, corridor.road_right, *corridor.lane_left, *corridor.lane_right]
    for border in borders:
        points = centre + border[near, None] * normal
        known = ~np.isnan(points).any(axis=1)
        for part in np.split(np.flatnonzero(known), np.flatnonzero(np.diff(np.flatnonzero(known)) > 1) + 1):
            if part.size > 1:
                entity.lines.append(
                    LinePrimitive(
                        type=LinePrimitive.LINE_STRIP,
                        pose=_pose(0.0, 0.0, 0.0, 0.0),
                        thickness=1.5,
                        scale_invariant=True,
                        points=[Point3(x=float(x), y=float(y)) for x, y in points[part]],
                        color=LINE_COLOUR,
                    )
                )
    return SceneUpdate(entities=[entity])


def _transform(trace: Trace, k: int, origin: np.ndarray) -> FrameTransform:
    agent = trace.agents[k, trace.ego]
    x, y = (agent[[A.X_M, A.Y_M]] - origin).tolist()
    pose = _pose(x, y, 0.0, float(agent[A.HEADING_RAD]))
    return FrameTransform(
        timestamp=_timestamp(float(trace.time_s[k])),
        parent_frame_id=MAP,
        child_frame_id=EGO,
        translation=pose.position,
        rotation=pose.orientation,
    )


def _lidar(trace: Trace, k: int, rays: int) -> LaserScan:
    ranges, rates = np.empty(rays), np.empty(rays)
    agents = np.ascontiguousarray(trace.agents[k])
    scan(agents, len(agents), trace.ego, beam_directions(rays), LIDAR_RANGE_M, ranges, rates)
    return LaserScan(
        timestamp=_timestamp(float(trace.time_s[k])),
        frame_id=EGO,
        pose=_pose(0.0, 0.0, 0.5 * HEIGHT_M, 0.0),
        start_angle=0.0,
        end_angle=2.0 * math.pi * (rays - 1) / rays,
        ranges=ranges.tolist(),
        intensities=rates.tolist(),
    )


def _ego(trace: Trace, k: int) -> dict[str, float | None]:
    agent, ttc_s = trace.agents[k, trace.ego], float(trace.ttc_s[k])
    action = trace.actions[k].tolist() if k < len(trace.actions) else (None, None)
    return {
        "time_s": float(trace.time_s[k]),
        "ttc_s": ttc_s if math.isfinite(ttc_s) else None,
        "speed_mps": float(agent[A.SPEED_MPS]),
        "acceleration_mps2": action[0],
        "turn_rate_radps": action[1],
        "station_m": float(trace.station_m[k, trace.ego]),
    }
