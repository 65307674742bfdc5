from google.protobuf.internal import containers as _containers
from google.protobuf.internal import enum_type_wrapper as _enum_type_wrapper
from google.protobuf import descriptor as _descriptor
from google.protobuf import message as _message
from collections.abc import Iterable as _Iterable, Mapping as _Mapping
from typing import ClassVar as _ClassVar, Optional as _Optional, Union as _Union

DESCRIPTOR: _descriptor.FileDescriptor

class Camera(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
    __slots__ = ()
    CAMERA_NONE: _ClassVar[Camera]
    CAMERA_RAW: _ClassVar[Camera]
    CAMERA_JPEG: _ClassVar[Camera]
CAMERA_NONE: Camera
CAMERA_RAW: Camera
CAMERA_JPEG: Camera

class Request(_message.Message):
    __slots__ = ("hello", "reset", "observation", "goodbye", "render")
    HELLO_FIELD_NUMBER: _ClassVar[int]
    RESET_FIELD_NUMBER: _ClassVar[int]
    OBSERVATION_FIELD_NUMBER: _ClassVar[int]
    GOODBYE_FIELD_NUMBER: _ClassVar[int]
    RENDER_FIELD_NUMBER: _ClassVar[int]
    hello: Hello
    reset: Reset
    observation: Observation
    goodbye: Goodbye
    render: Render
    def __init__(self, hello: _Optional[_Union[Hello, _Mapping]] = ..., reset: _Optional[_Union[Reset, _Mapping]] = ..., observation: _Optional[_Union[Observation, _Mapping]] = ..., goodbye: _Optional[_Union[Goodbye, _Mapping]] = ..., render: _Optional[_Union[Render, _Mapping]] = ...) -> None: ...

class Reply(_message.Message):
    __slots__ = ("welcome", "ready", "action", "picture", "refusal")
    WELCOME_FIELD_NUMBER: _ClassVar[int]
    READY_FIELD_NUMBER: _ClassVar[int]
    ACTION_FIELD_NUMBER: _ClassVar[int]
    PICTURE_FIELD_NUMBER: _ClassVar[int]
    REFUSAL_FIELD_NUMBER: _ClassVar[int]
    welcome: Welcome
    ready: Ready
    action: Action
    picture: Picture
    refusal: Refusal
    def __init__(self, welcome: _Optional[_Union[Welcome, _Mapping]] = ..., ready: _Optional[_Union[Ready, _Mapping]] = ..., action: _Optional[_Union[Action, _Mapping]] = ..., picture: _Optional[_Union[Picture, _Mapping]] = ..., refusal: _Optional[_Union[Refusal, _Mapping]] = ...) -> None: ...

class Hello(_message.Message):
    __slots__ = ("version", "worker", "scenario", "step_s", "deadline_s")
    VERSION_FIELD_NUMBER: _ClassVar[int]
    WORKER_FIELD_NUMBER: _ClassVar[int]
    SCENARIO_FIELD_NUMBER: _ClassVar[int]
    STEP_S_FIELD_NUMBER: _ClassVar[int]
    DEADLINE_S_FIELD_NUMBER: _ClassVar[int]
    version: int
    worker: str
    scenario: str
    step_s: float
    deadline_s: float
    def __init__(self, version: _Optional[int] = ..., worker: _Optional[str] = ..., scenario: _Optional[str] = ..., step_s: _Optional[float] = ..., deadline_s: _Optional[float] = ...) -> None: ...

class Welcome(_message.Message):
    __slots__ = ("version", "instance", "sessions", "camera", "route")
    VERSION_FIELD_NUMBER: _ClassVar[int]
    INSTANCE_FIELD_NUMBER: _ClassVar[int]
    SESSIONS_FIELD_NUMBER: _ClassVar[int]
    CAMERA_FIELD_NUMBER: _ClassVar[int]
    ROUTE_FIELD_NUMBER: _ClassVar[int]
    version: int
    instance: str
    sessions: int
    camera: Camera
    route: bool
    def __init__(self, version: _Optional[int] = ..., instance: _Optional[str] = ..., sessions: _Optional[int] = ..., camera: _Optional[_Union[Camera, str]] = ..., route: _Optional[bool] = ...) -> None: ...

class Reset(_message.Message):
    __slots__ = ("worker", "rollout", "seed")
    WORKER_FIELD_NUMBER: _ClassVar[int]
    ROLLOUT_FIELD_NUMBER: _ClassVar[int]
    SEED_FIELD_NUMBER: _ClassVar[int]
    worker: str
    rollout: str
    seed: int
    def __init__(self, worker: _Optional[str] = ..., rollout: _Optional[str] = ..., seed: _Optional[int] = ...) -> None: ...

class Ready(_message.Message):
    __slots__ = ("rollout",)
    ROLLOUT_FIELD_NUMBER: _ClassVar[int]
    rollout: str
    def __init__(self, rollout: _Optional[str] = ...) -> None: ...

class Observation(_message.Message):
    __slots__ = ("worker", "rollout", "step", "time_s", "ego", "lidar", "picture", "route")
    WORKER_FIELD_NUMBER: _ClassVar[int]
    ROLLOUT_FIELD_NUMBER: _ClassVar[int]
    STEP_FIELD_NUMBER: _ClassVar[int]
    TIME_S_FIELD_NUMBER: _ClassVar[int]
    EGO_FIELD_NUMBER: _ClassVar[int]
    LIDAR_FIELD_NUMBER: _ClassVar[int]
    PICTURE_FIELD_NUMBER: _ClassVar[int]
    ROUTE_FIELD_NUMBER: _ClassVar[int]
    worker: str
    rollout: str
    step: int
    time_s: float
    ego: EgoState
    lidar: Lidar
    picture: Picture
    route: Route
    def __init__(self, worker: _Optional[str] = ..., rollout: _Optional[str] = ..., step: _Optional[int] = ..., time_s: _Optional[float] = ..., ego: _Optional[_Union[EgoState, _Mapping]] = ..., lidar: _Optional[_Union[Lidar, _Mapping]] = ..., picture: _Optional[_Union[Picture, _Mapping]] = ..., route: _Optional[_Union[Route, _Mapping]] = ...) -> None: ...

class EgoState(_message.Message):
    __slots__ = ("x_m", "y_m", "heading_rad", "speed_mps", "acceleration_mps2", "turn_rate_radps", "length_m", "width_m", "lane", "station_m", "lane_offset_m", "lane_heading_rad", "lane_curvature_per_m", "left_marking_m", "right_marking_m", "lane_to_the_left", "lane_to_the_right", "incident")
    X_M_FIELD_NUMBER: _ClassVar[int]
    Y_M_FIELD_NUMBER: _ClassVar[int]
    HEADING_RAD_FIELD_NUMBER: _ClassVar[int]
    SPEED_MPS_FIELD_NUMBER: _ClassVar[int]
    ACCELERATION_MPS2_FIELD_NUMBER: _ClassVar[int]
    TURN_RATE_RADPS_FIELD_NUMBER: _ClassVar[int]
    LENGTH_M_FIELD_NUMBER: _ClassVar[int]
    WIDTH_M_FIELD_NUMBER: _ClassVar[int]
    LANE_FIELD_NUMBER: _ClassVar[int]
    STATION_M_FIELD_NUMBER: _ClassVar[int]
    LANE_OFFSET_M_FIELD_NUMBER: _ClassVar[int]
    LANE_HEADING_RAD_FIELD_NUMBER: _ClassVar[int]
    LANE_CURVATURE_PER_M_FIELD_NUMBER: _ClassVar[int]
    LEFT_MARKING_M_FIELD_NUMBER: _ClassVar[int]
    RIGHT_MARKING_M_FIELD_NUMBER: _ClassVar[int]
    LANE_TO_THE_LEFT_FIELD_NUMBER: _ClassVar[int]
    LANE_TO_THE_RIGHT_FIELD_NUMBER: _ClassVar[int]
    INCIDENT_FIELD_NUMBER: _ClassVar[int]
    x_m: float
    y_m: float
    heading_rad: float
    speed_mps: float
    acceleration_mps2: float
    turn_rate_radps: float
    length_m: float
    width_m: float
    lane: int
    station_m: float
    lane_offset_m: float
    lane_heading_rad: float
    lane_curvature_per_m: float
    left_marking_m: float
    right_marking_m: float
    lane_to_the_left: bool
    lane_to_the_right: bool
    incident: bool
    def __init__(self, x_m: _Optional[float] = ..., y_m: _Optional[float] = ..., heading_rad: _Optional[float] = ..., speed_mps: _Optional[float] = ..., acceleration_mps2: _Optional[float] = ..., turn_rate_radps: _Optional[float] = ..., length_m: _Optional[float] = ..., width_m: _Optional[float] = ..., lane: _Optional[int] = ..., station_m: _Optional[float] = ..., lane_offset_m: _Optional[float] = ..., lane_heading_rad: _Optional[float] = ..., lane_curvature_per_m: _Optional[float] = ..., left_marking_m: _Optional[float] = ..., right_marking_m: _Optional[float] = ..., lane_to_the_left: _Optional[bool] = ..., lane_to_the_right: _Optional[bool] = ..., incident: _Optional[bool] = ...) -> None: ...

class Lidar(_message.Message):
    __slots__ = ("limit_m", "range_m", "range_rate_mps")
    LIMIT_M_FIELD_NUMBER: _ClassVar[int]
    RANGE_M_FIELD_NUMBER: _ClassVar[int]
    RANGE_RATE_MPS_FIELD_NUMBER: _ClassVar[int]
    limit_m: float
    range_m: _containers.RepeatedScalarFieldContainer[float]
    range_rate_mps: _containers.RepeatedScalarFieldContainer[float]
    def __init__(self, limit_m: _Optional[float] = ..., range_m: _Optional[_Iterable[float]] = ..., range_rate_mps: _Optional[_Iterable[float]] = ...) -> None: ...

class Picture(_message.Message):
    __slots__ = ("encoding", "width", "height", "data")
    ENCODING_FIELD_NUMBER: _ClassVar[int]
    WIDTH_FIELD_NUMBER: _ClassVar[int]
    HEIGHT_FIELD_NUMBER: _ClassVar[int]
    DATA_FIELD_NUMBER: _ClassVar[int]
    encoding: Camera
    width: int
    height: int
    data: bytes
    def __init__(self, encoding: _Optional[_Union[Camera, str]] = ..., width: _Optional[int] = ..., height: _Optional[int] = ..., data: _Optional[bytes] = ...) -> None: ...

class Route(_message.Message):
    __slots__ = ("x_m", "y_m")
    X_M_FIELD_NUMBER: _ClassVar[int]
    Y_M_FIELD_NUMBER: _ClassVar[int]
    x_m: _containers.RepeatedScalarFieldContainer[float]
    y_m: _containers.RepeatedScalarFieldContainer[float]
    def __init__(self, x_m: _Optional[_Iterable[float]] = ..., y_m: _Optional[_Iterable[float]] = ...) -> None: ...

class Action(_message.Message):
    __slots__ = ("rollout", "step", "motion", "pedals")
    ROLLOUT_FIELD_NUMBER: _ClassVar[int]
    STEP_FIELD_NUMBER: _ClassVar[int]
    MOTION_FIELD_NUMBER: _ClassVar[int]
    PEDALS_FIELD_NUMBER: _ClassVar[int]
    rollout: str
    step: int
    motion: Motion
    pedals: Pedals
    def __init__(self, rollout: _Optional[str] = ..., step: _Optional[int] = ..., motion: _Optional[_Union[Motion, _Mapping]] = ..., pedals: _Optional[_Union[Pedals, _Mapping]] = ...) -> None: ...

class Motion(_message.Message):
    __slots__ = ("acceleration_mps2", "turn_rate_radps")
    ACCELERATION_MPS2_FIELD_NUMBER: _ClassVar[int]
    TURN_RATE_RADPS_FIELD_NUMBER: _ClassVar[int]
    acceleration_mps2: float
    turn_rate_radps: float
    def __init__(self, acceleration_mps2: _Optional[float] = ..., turn_rate_radps: _Optional[float] = ...) -> None: ...

class Pedals(_message.Message):
    __slots__ = ("steering_rad", "throttle")
    STEERING_RAD_FIELD_NUMBER: _ClassVar[int]
    THROTTLE_FIELD_NUMBER: _ClassVar[int]
    steering_rad: float
    throttle: float
    def __init__(self, steering_rad: _Optional[float] = ..., throttle: _Optional[float] = ...) -> None: ...

class Goodbye(_message.Message):
    __slots__ = ("worker",)
    WORKER_FIELD_NUMBER: _ClassVar[int]
    worker: str
    def __init__(self, worker: _Optional[str] = ...) -> None: ...

class Refusal(_message.Message):
    __slots__ = ("reason",)
    REASON_FIELD_NUMBER: _ClassVar[int]
    reason: str
    def __init__(self, reason: _Optional[str] = ...) -> None: ...

class Render(_message.Message):
    __slots__ = ("worker", "scenario", "seed", "frame", "ego", "pose", "weather")
    WORKER_FIELD_NUMBER: _ClassVar[int]
    SCENARIO_FIELD_NUMBER: _ClassVar[int]
    SEED_FIELD_NUMBER: _ClassVar[int]
    FRAME_FIELD_NUMBER: _ClassVar[int]
    EGO_FIELD_NUMBER: _ClassVar[int]
    POSE_FIELD_NUMBER: _ClassVar[int]
    WEATHER_FIELD_NUMBER: _ClassVar[int]
    worker: str
    scenario: str
    seed: int
    frame: int
    ego: int
    pose: _containers.RepeatedScalarFieldContainer[float]
    weather: _containers.RepeatedScalarFieldContainer[float]
    def __init__(self, worker: _Optional[str] = ..., scenario: _Optional[str] = ..., seed: _Optional[int] = ..., frame: _Optional[int] = ..., ego: _Optional[int] = ..., pose: _Optional[_Iterable[float]] = ..., weather: _Optional[_Iterable[float]] = ...) -> None: ...
