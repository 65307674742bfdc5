"""An ASAM OpenSCENARIO XML file in which every vehicle follows a trajectory, as states that measures are taken of.

Read: vehicles written out, FollowTrajectoryAction along a Polyline of WorldPosition, in absolute time. A vehicle's
speed is the property SPEEDS of files that tailroad wrote, else the change of its position. After its last vertex a
vehicle is off the road. Everything else that moves a vehicle is refused by its name: it would have to be guessed.
"""

from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree as ET

import msgspec
import numpy as np

from service.analysis.exports.openscenario import SPEEDS
from service.errors import InputError
from service.world import agents as A
from service.world.safety.boxes import clearance
from service.world.safety.measure import open_monitor, with_measure
from service.world.safety.ttc import ego_time_to_collision
from service.world.scenario.load import load_scenario
from service.world.scenario.schema import Time, Vehicle
from service.world.sensors.lidar import beam_directions
from sumo_nets.asam_xml import root_of
from sumo_nets.errors import NetworkError

STEP_S = 0.1
LARGEST_BYTES = 256 << 20
MOST_STEPS, MOST_VEHICLES = 100_000, 64
MEASURES = ("ttc", "ttc-impact", "box-ttc", "drac", "pet")  # that need no lanes
MODEL = "i80-10s"
ROUNDED_S = 1e-6
GENERAL = (
    "PrivateAction",
    "GlobalAction",
    "LongitudinalAction",
    "LateralAction",
    "RoutingAction",
    "ControllerAction",
)
FOLLOW = "PrivateAction/RoutingAction/FollowTrajectoryAction"


# times, x, y and heading of the box's middle, speeds or none, length and width
Track = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]


@dataclass(frozen=True)
class Drive:
    """States every STEP_S.

    agents: (T, vehicles, columns of service.world.agents): boxes, headings, speeds and whether active
    ego: which vehicle
    """

    names: tuple[str, ...]
    ego: int
    agents: np.ndarray


def read_openscenario(path: Path, ego: str | None = None) -> Drive:
    """The drive of a file; InputError, one line, where it is none or holds what is not read.

    ego: the ego's name; otherwise the vehicle that is called ego
    """
    root = _root(path)
    objects = root.findall("Entities/ScenarioObject")
    names = tuple(one.get("name", "") for one in objects)
    if not 1 <= len(names) <= MOST_VEHICLES or len(set(names)) < len(names):
        raise InputError(
            f"{path}: {len(names)} entities; expected 1 to {MOST_VEHICLES} vehicles of different names"
        )
    moved = _followed(path, root)
    tracks = []
    for name, one in zip(names, objects, strict=True):
        if name not in moved:
            raise InputError(
                f"{path}: {name} follows no trajectory; expected a FollowTrajectoryAction for each vehicle"
            )
        tracks.append(_track(path, name, one, moved[name]))
    wanted = (ego or "ego").lower()
    found = [i for i, name in enumerate(names) if name.lower() == wanted]
    if not found:
        raise InputError(
            f"{path}: no vehicle is called {ego or 'ego'}; name one of {', '.join(names)} with --ego"
        )
    end = tracks[found[0]][0][-1]
    steps = int(np.floor((end + ROUNDED_S) / STEP_S)) + 1
    if steps > MOST_STEPS:
        raise InputError(f"{path}: the ego drives {end:g} s; expected {MOST_STEPS * STEP_S:g} s at most")
    agents = np.zeros((steps, len(names), A.COLUMNS))
    for i, track in enumerate(tracks):
        agents[:, i] = _states(*track, np.arange(steps) * STEP_S)
    return Drive(names, found[0], agents)


def f_of(drive: Drive, measure: str) -> tuple[float, np.ndarray]:
    """f of a drive until the ego's first contact, and the measure at each state (T,). InputError for other measures."""
    if measure not in MEASURES:
        raise InputError(
            f"measure {measure[:80]!r}: of trajectories without lanes there are {', '.join(MEASURES)}"
        )
    model = load_scenario(MODEL)
    vehicles = tuple(
        Vehicle(name=f"v{i}", lane=1, role="ego" if i == drive.ego else "environment")
        for i in range(len(drive.names))
    )
    time = Time(horizon_s=max(1, len(drive.agents) - 1) * STEP_S, step_s=STEP_S)
    scenario = with_measure(msgspec.structs.replace(model, vehicles=vehicles, time=time), measure)
    monitor = open_monitor(scenario, len(vehicles))
    angles = beam_directions(scenario.safety.rays)
    ranges, rates = np.zeros(len(angles)), np.zeros(len(angles))
    seen = []
    for state in drive.agents:
        ttc_s = ego_time_to_collision(state, len(vehicles), drive.ego, angles, ranges, rates)
        seen.append(ttc_s)
        if monitor is not None:
            monitor.see(state, len(vehicles), ttc_s)
        if len(vehicles) > 1 and clearance(state, len(vehicles), drive.ego) <= 0.0:
            break
    values = np.array(seen) if monitor is None else monitor.trace()
    return (float(values.min()) if monitor is None else monitor.value()), values


def _root(path: Path) -> ET.Element:
    try:
        root = root_of(path, "OpenSCENARIO", LARGEST_BYTES)
    except NetworkError as error:
        raise InputError(str(error)) from error
    if root.tag != "OpenSCENARIO":
        raise InputError(f"{path}: <{root.tag[:40]}>; expected an ASAM OpenSCENARIO XML file")
    if root.find("Storyboard") is None:
        raise InputError(f"{path}: no Storyboard (a catalog?); expected a scenario")
    return root


def _followed(path: Path, root: ET.Element) -> dict[str, ET.Element]:
    """The trajectory action of each vehicle; InputError for any other action in the stories."""
    moved: dict[str, ET.Element] = {}
    for group in root.iter("ManeuverGroup"):
        actors = [one.get("entityRef", "") for one in group.findall("Actors/EntityRef")]
        for event in group.iter("Event"):
            for action in event.findall("Action"):
                follow = action.find(FOLLOW)
                if follow is None:
                    kinds = [
                        part.tag
                        for part in action.iter()
                        if part.tag.endswith("Action") and part.tag != "Action"
                    ]
                    kind = next((k for k in kinds if k not in GENERAL), kinds[-1] if kinds else "no action")
                    raise InputError(
                        f"{path}: {kind} of {', '.join(actors) or 'nobody'} in {event.get('name', 'an event')!r}; only "
                        "FollowTrajectoryAction is read: have the tool that plays the file record its trajectories"
                    )
                for name in actors:
                    if name in moved:
                        raise InputError(f"{path}: {name} follows two trajectories; expected one")
                    moved[name] = follow
    return moved


def _track(path: Path, name: str, entity: ET.Element, follow: ET.Element) -> Track:
    """The track of a vehicle."""
    vehicle = entity.find("Vehicle")
    if vehicle is None:
        kind = next((part.tag for part in entity), "nothing")
        raise InputError(f"{path}: {name} is given as {kind}; expected a Vehicle that is written out")
    timing = follow.find("TimeReference/Timing")
    if timing is None or timing.get("domainAbsoluteRelative") != "absolute":
        raise InputError(
            f"{path}: the trajectory of {name} has no absolute times; expected TimeReference/Timing absolute"
        )
    line = follow.find("TrajectoryRef/Trajectory/Shape/Polyline")
    if line is None:
        raise InputError(f"{path}: the trajectory of {name} is no Polyline, or lies in a catalog")
    rows = []
    for vertex in line.findall("Vertex"):
        position = next(iter(vertex.findall("Position/*")), None)
        if position is None or position.tag != "WorldPosition":
            lies = "nothing" if position is None else position.tag
            raise InputError(f"{path}: a vertex of {name} lies at {lies}; expected WorldPosition")
        rows.append([_number(path, name, vertex, "time"), *(_number(path, name, position, k) for k in "xy"),
                     _number(path, name, position, "h", 0.0)])  # fmt: skip
    given = np.array(rows, dtype=np.float64).reshape(len(rows), 4)
    if len(given) < 2 or not (np.diff(given[:, 0]) > 0.0).all():
        raise InputError(
            f"{path}: the trajectory of {name} has {len(given)} vertices; expected two or more in order of time"
        )
    scale, offset = (
        _number(path, name, timing, key, default) for key, default in (("scale", 1.0), ("offset", 0.0))
    )
    size, centre = vehicle.find("BoundingBox/Dimensions"), vehicle.find("BoundingBox/Center")
    if size is None or centre is None:
        raise InputError(f"{path}: {name} has no BoundingBox; expected Center and Dimensions")
    ahead, aside = (_number(path, name, centre, key) for key in "xy")
    x, y, heading = given[:, 1], given[:, 2], np.unwrap(given[:, 3])
    cos, sin = np.cos(heading), np.sin(heading)
    box = np.array([_number(path, name, size, "length"), _number(path, name, size, "width")])
    told = vehicle.find(f"Properties/Property[@name='{SPEEDS}']")
    speeds = np.zeros(0)
    if told is not None:
        try:
            speeds = np.array([float(word) for word in (told.get("value") or "").split()])
        except ValueError as error:
            raise InputError(
                f"{path}: property {SPEEDS} of {name}: {error}; expected a speed a vertex"
            ) from error
        if len(speeds) != len(given) or not np.isfinite(speeds).all():
            raise InputError(
                f"{path}: property {SPEEDS} of {name}: {len(speeds)} speeds of {len(given)} vertices"
            )
    return (
        scale * given[:, 0] + offset,
        x + ahead * cos - aside * sin,
        y + ahead * sin + aside * cos,
        heading,
        speeds,
        box,
    )


def _states(
    t: np.ndarray,
    x: np.ndarray,
    y: np.ndarray,
    heading: np.ndarray,
    speeds: np.ndarray,
    box: np.ndarray,
    at: np.ndarray,
) -> np.ndarray:
    """States (T, COLUMNS) of a track at times `at` (T,)."""
    if not len(speeds):
        speeds = np.hypot(np.gradient(x, t), np.gradient(y, t))
    out = np.zeros((len(at), A.COLUMNS))
    for column, values in ((A.X_M, x), (A.Y_M, y), (A.HEADING_RAD, heading), (A.SPEED_MPS, speeds)):
        out[:, column] = np.interp(at, t, values)
    out[:, A.LENGTH_M], out[:, A.WIDTH_M] = box
    out[:, A.COS], out[:, A.SIN] = np.cos(out[:, A.HEADING_RAD]), np.sin(out[:, A.HEADING_RAD])
    out[:, A.ACTIVE] = (at >= t[0] - ROUNDED_S) & (at <= t[-1] + ROUNDED_S)
    return out


def _number(path: Path, name: str, element: ET.Element, key: str, default: float | None = None) -> float:
    text = element.get(key)
    if text is None and default is not None:
        return default
    try:
        value = float(text or "")
    except ValueError:
        value = np.nan
    if not np.isfinite(value):
        raise InputError(
            f"{path}: {key} = {text!r} in {element.tag} of {name}; expected a number (no parameters)"
        )
    return value
