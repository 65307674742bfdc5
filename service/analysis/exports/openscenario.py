"""A rollout as an ASAM OpenSCENARIO XML 1.3 file: every vehicle follows the trajectory that it drove.

Trajectories have a vertex for each step, in absolute time, in the coordinates of the road's SUMO network. A vehicle's
position in OpenSCENARIO is the middle of its rear axle on the ground, tailroad's is the middle of its box: the axle is
put REAR_AXLE of its length behind it, and the bounding box is told from there. A vehicle that has left the road stays
where it left. Speeds, which a vertex cannot say, are a property of each vehicle (SPEEDS), for those who read it again.
"""

from datetime import datetime
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np

from service.analysis.trace import Trace
from service.world import agents as A

REAR_AXLE = 0.3  # of the length, behind the middle; the front axle as far ahead of it
HEIGHT_M, TRUCK_HEIGHT_M = 1.5, 3.5
TRUCK_FROM_M = 7.0  # of length
WHEEL_M, TRACK_SHARE, STEERING_RAD = 0.65, 0.85, 0.6
TOP_SPEED_MPS, ACCELERATION_MPS2, DECELERATION_MPS2 = 60.0, 4.0, 8.0
SPEEDS = "tailroad speed_mps"  # one a vertex
Numbers = dict[str, str]


def openscenario_text(trace: Trace, title: str, made: datetime, road: str | None = None) -> str:
    """The XML of a rollout.

    title: what it is called
    made: when, with a time zone
    road: the ASAM OpenDRIVE file of the road, beside the scenario; None: the file names none
    """
    root = ET.Element("OpenSCENARIO")
    header = {"revMajor": "1", "revMinor": "3", "date": made.isoformat(timespec="seconds")}
    ET.SubElement(root, "FileHeader", header | {"description": title, "author": "tailroad"})
    ET.SubElement(root, "CatalogLocations")
    network = ET.SubElement(root, "RoadNetwork")
    if road is not None:
        ET.SubElement(network, "LogicFile", filepath=road)
    entities = ET.SubElement(root, "Entities")
    for i, name in enumerate(trace.names):
        _vehicle(ET.SubElement(entities, "ScenarioObject", name=name), name, trace.agents[:, i])
    board = ET.SubElement(root, "Storyboard")
    actions = ET.SubElement(ET.SubElement(board, "Init"), "Actions")
    for i, name in enumerate(trace.names):
        _begin(ET.SubElement(actions, "Private", entityRef=name), trace.agents[0, i])
    act = ET.SubElement(ET.SubElement(board, "Story", name="drive"), "Act", name="drive")
    for i, name in enumerate(trace.names):
        _drive(act, name, trace.time_s, trace.agents[:, i])
    _after(ET.SubElement(act, "StartTrigger"), "begin", 0.0)
    _after(ET.SubElement(board, "StopTrigger"), "end", float(trace.time_s[-1]))
    ET.indent(root)
    return ET.tostring(root, encoding="unicode", xml_declaration=True) + "\n"


def write_openscenario(trace: Trace, path: Path, title: str, made: datetime, road: str | None = None) -> None:
    """Write `openscenario_text` to a file."""
    path.write_text(openscenario_text(trace, title, made, road), encoding="utf-8")


def _vehicle(parent: ET.Element, name: str, agents: np.ndarray) -> None:
    agent = agents[0]
    length, width = float(agent[A.LENGTH_M]), float(agent[A.WIDTH_M])
    truck = length >= TRUCK_FROM_M
    height = TRUCK_HEIGHT_M if truck else HEIGHT_M
    category = {"vehicleCategory": "truck" if truck else "car"}
    vehicle = ET.SubElement(parent, "Vehicle", {"name": name} | category)
    box = ET.SubElement(vehicle, "BoundingBox")
    ET.SubElement(box, "Center", _numbers(x=REAR_AXLE * length, y=0.0, z=height / 2))
    ET.SubElement(box, "Dimensions", _numbers(width=width, length=length, height=height))
    limits = _numbers(
        maxSpeed=TOP_SPEED_MPS, maxAcceleration=ACCELERATION_MPS2, maxDeceleration=DECELERATION_MPS2
    )
    ET.SubElement(vehicle, "Performance", limits)
    axles = ET.SubElement(vehicle, "Axles")
    wheels = {"wheelDiameter": WHEEL_M, "trackWidth": TRACK_SHARE * width, "positionZ": WHEEL_M / 2}
    ahead = 2 * REAR_AXLE * length
    ET.SubElement(axles, "FrontAxle", _numbers(maxSteering=STEERING_RAD, positionX=ahead, **wheels))
    ET.SubElement(axles, "RearAxle", _numbers(maxSteering=0.0, positionX=0.0, **wheels))
    speeds = " ".join(repr(float(speed)) for speed in agents[: _on_road(agents), A.SPEED_MPS])
    ET.SubElement(ET.SubElement(vehicle, "Properties"), "Property", name=SPEEDS, value=speeds)


def _begin(private: ET.Element, agent: np.ndarray) -> None:
    _at(ET.SubElement(ET.SubElement(private, "PrivateAction"), "TeleportAction"), agent)
    along = ET.SubElement(ET.SubElement(private, "PrivateAction"), "LongitudinalAction")
    speed = ET.SubElement(along, "SpeedAction")
    dynamics = {"dynamicsShape": "step", "dynamicsDimension": "time", "value": "0"}
    ET.SubElement(speed, "SpeedActionDynamics", dynamics)
    target = ET.SubElement(speed, "SpeedActionTarget")
    ET.SubElement(target, "AbsoluteTargetSpeed", _numbers(value=agent[A.SPEED_MPS]))


def _drive(act: ET.Element, name: str, time_s: np.ndarray, agents: np.ndarray) -> None:
    group = ET.SubElement(act, "ManeuverGroup", name=f"{name} drives", maximumExecutionCount="1")
    actors = ET.SubElement(group, "Actors", selectTriggeringEntities="false")
    ET.SubElement(actors, "EntityRef", entityRef=name)
    maneuver = ET.SubElement(group, "Maneuver", name=f"{name} drives")
    event = ET.SubElement(maneuver, "Event", name=f"{name} drives", priority="override")
    action = ET.SubElement(event, "Action", name=f"{name} follows its trajectory")
    routing = ET.SubElement(ET.SubElement(action, "PrivateAction"), "RoutingAction")
    follow = ET.SubElement(routing, "FollowTrajectoryAction")
    trajectory = ET.SubElement(
        ET.SubElement(follow, "TrajectoryRef"), "Trajectory", name=f"trajectory of {name}", closed="false"
    )
    line = ET.SubElement(ET.SubElement(trajectory, "Shape"), "Polyline")
    for time, agent in zip(time_s[: _on_road(agents)], agents, strict=False):
        _at(ET.SubElement(line, "Vertex", _numbers(time=time)), agent)
    timing = {"domainAbsoluteRelative": "absolute", "scale": "1", "offset": "0"}
    ET.SubElement(ET.SubElement(follow, "TimeReference"), "Timing", timing)
    ET.SubElement(follow, "TrajectoryFollowingMode", followingMode="position")
    _after(ET.SubElement(event, "StartTrigger"), f"{name} begins", 0.0)


def _on_road(agents: np.ndarray) -> int:
    """How many states, of (T, columns), a vehicle is on the road."""
    return int(np.flatnonzero(agents[:, A.ACTIVE])[-1]) + 1 if agents[:, A.ACTIVE].any() else 1


def _at(parent: ET.Element, agent: np.ndarray) -> None:
    """The middle of the rear axle."""
    behind, heading = REAR_AXLE * agent[A.LENGTH_M], agent[A.HEADING_RAD]
    x, y = agent[A.X_M] - behind * np.cos(heading), agent[A.Y_M] - behind * np.sin(heading)
    ET.SubElement(ET.SubElement(parent, "Position"), "WorldPosition", _numbers(x=x, y=y, z=0.0, h=heading))


def _after(trigger: ET.Element, name: str, time_s: float) -> None:
    group = ET.SubElement(trigger, "ConditionGroup")
    condition = ET.SubElement(group, "Condition", name=name, delay="0", conditionEdge="none")
    value = ET.SubElement(condition, "ByValueCondition")
    ET.SubElement(value, "SimulationTimeCondition", _numbers(value=time_s) | {"rule": "greaterOrEqual"})


def _numbers(**values: float) -> Numbers:
    return {key: f"{float(value):.9f}".rstrip("0").rstrip(".") for key, value in values.items()}
