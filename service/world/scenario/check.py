"""What a well-formed scenario can still get wrong: values that cannot be, and a road that does not fit."""

import math
import re

import numpy as np

from policies.layout import HEAD_SIZE
from service.errors import InputError, ScenarioError
from service.world.scenario.check_camera import Refuse, check_camera
from service.world.scenario.check_human import check_human, check_lateral, steepest
from service.world.scenario.measures import split_measure
from service.world.scenario.noise import noise_of
from service.world.scenario.schema import (
    Beta,
    Distribution,
    Fixed,
    NormalMixture,
    RandomWeather,
    Rss,
    Scenario,
    TruncatedNormal,
    Vehicle,
)
from sumo_nets.corridor import Corridor, load_corridor
from sumo_nets.errors import EdgesError, NetworkError

MAX_VEHICLES = 64
MAX_STEPS = 100_000
MAX_SEARCHED = 20_000  # standard normals of action noise that a search may have to move
MAX_SPEED_MPS = 70.0
DISTRIBUTIONS = ("station_m", "lane_offset_m", "heading_deg", "lateral_mps", "speed_mps")
# the widest values that make sense, and what a value beyond them usually is
PLAUSIBLE = {
    "lane_offset_m": (-10.0, 10.0, "an offset from the lane's centre is a few metres at most"),
    "heading_deg": (-90.0, 90.0, "a heading is relative to the lane, within 90 degrees"),
    "lateral_mps": (-5.0, 5.0, "nobody moves across faster than 5 m/s"),
    "speed_mps": (
        0.0,
        MAX_SPEED_MPS,
        f"speeds are metres per second, 0 to {MAX_SPEED_MPS:g}; divide km/h by 3.6",
    ),
}


def check_values(scenario: Scenario, source: str) -> None:
    """Raise ScenarioError for values that cannot be, without opening the network."""

    def refuse(key: str, given: object, remedy: str) -> None:
        raise ScenarioError(source, key, given, remedy)

    if not re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9._-]{0,63}", scenario.name):
        refuse("name", scenario.name, "use up to 64 letters, digits, '.', '_' and '-'")
    step = scenario.time.step_s
    if not 0.001 <= step <= 1.0:
        refuse("time.step_s", step, "give a step between 0.001 and 1 second; 0.1 is usual")
    if abs(step * 1000 - round(step * 1000)) > 1e-9:
        refuse("time.step_s", step, "SUMO's clock counts whole milliseconds; give a multiple of 0.001")
    if scenario.time.horizon_s < step:
        refuse("time.horizon_s", scenario.time.horizon_s, f"give at least one step ({step} s)")
    if scenario.time.horizon_s > MAX_STEPS * step:
        refuse(
            "time.horizon_s",
            scenario.time.horizon_s,
            f"more than {MAX_STEPS} steps; give at most {MAX_STEPS * step:g} s",
        )
    if abs(scenario.steps * step - scenario.time.horizon_s) > 1e-6:
        refuse("time.horizon_s", scenario.time.horizon_s, f"not a whole number of steps of {step} s")
    try:
        split_measure(scenario.safety.measure)
    except ValueError as error:
        refuse("safety.measure", scenario.safety.measure, str(error))
    for name in Rss.__struct_fields__:
        if not 0.01 <= getattr(scenario.safety.rss, name) <= 100.0:
            refuse(f"safety.rss.{name}", getattr(scenario.safety.rss, name), "give 0.01 to 100")
    if not 1 <= scenario.safety.rays <= 3600:
        refuse("safety.rays", scenario.safety.rays, "give 1 to 3600 rays; the paper uses 20")
    if not 1 <= len(scenario.vehicles) <= MAX_VEHICLES:
        refuse("vehicles", len(scenario.vehicles), f"give 1 to {MAX_VEHICLES} vehicles")
    check_lateral(scenario, refuse)
    egos = [v.name for v in scenario.vehicles if v.role == "ego"]
    if len(egos) != 1:
        refuse("vehicles", egos, 'exactly one vehicle must have role = "ego"')
    seen: set[str] = set()
    for i, vehicle in enumerate(scenario.vehicles):
        if not re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9_-]{0,31}", vehicle.name):
            refuse(f"vehicles[{i}].name", vehicle.name, "use up to 32 letters, digits, '_' and '-'")
        if vehicle.name in seen:
            refuse(f"vehicles[{i}].name", vehicle.name, "two vehicles have this name; give each its own")
        seen.add(vehicle.name)
        for key in ("length_m", "width_m"):
            size = scenario.of(vehicle, key)
            if not 0.3 <= size <= 30.0:
                refuse(_key(vehicle, i, key), size, "vehicles are 0.3 to 30 m; check the unit")
        for key in scenario.start_names:
            _check_distribution(scenario.of(vehicle, key), key, _key(vehicle, i, key), refuse)
    background = scenario.background
    if background is not None:
        if not 0.0 < background.density_veh_per_km_lane <= 100.0:
            refuse(
                "background.density_veh_per_km_lane",
                background.density_veh_per_km_lane,
                "give above 0 up to 100",
            )
        if not 0.0 < background.speed_mps <= MAX_SPEED_MPS:
            refuse("background.speed_mps", background.speed_mps, f"give above 0 up to {MAX_SPEED_MPS:g} m/s")
    _check_noise_mode(scenario, refuse)
    check_human(scenario, refuse)
    check_camera(scenario, refuse)
    for key in () if scenario.weather is None else RandomWeather.__struct_fields__:
        _check_distribution(getattr(scenario.weather, key), key, f"weather.{key}", refuse)
    if scenario.fixed is not None:
        _check_fixed(scenario, scenario.fixed, refuse)
    _check_overlaps(scenario, source)


def check_road(scenario: Scenario, source: str) -> Corridor:
    """The scenario's road; ScenarioError where it is missing or does not carry the vehicles' starts."""
    network = scenario.network
    try:
        corridor = load_corridor(network.road, list(network.edges) or None)
    except EdgesError as error:
        raise ScenarioError(source, "network.edges", list(network.edges) or None, str(error)) from error
    except NetworkError as error:
        raise ScenarioError(source, "network.road", network.road, str(error)) from error
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        raise ScenarioError(source, "network.road", network.road, f"cannot be opened: {reason}") from error
    lanes = corridor.lane_left.shape[0]
    for i, vehicle in enumerate(scenario.vehicles):
        key = f"vehicles[{i}].lane"
        if not 1 <= vehicle.lane <= lanes:
            raise ScenarioError(source, key, vehicle.lane, f"the road has lanes 1 (leftmost) to {lanes}")
        station = scenario.of(vehicle, "station_m")
        if station.low < 0.0 or station.high > corridor.length_m:
            raise ScenarioError(
                source,
                _key(vehicle, i, "station_m"),
                f"{station.low:g} to {station.high:g}",
                f"the road goes from 0 to {corridor.length_m:.0f} m",
            )
        first, last = math.floor(station.low / corridor.ds_m), math.ceil(station.high / corridor.ds_m)
        if any(math.isnan(v) for v in corridor.lane_left[vehicle.lane - 1, first : last + 1]):
            raise ScenarioError(
                source,
                key,
                vehicle.lane,
                f"lane {vehicle.lane} does not exist over {station.low:g} to {station.high:g} m",
            )
        if corridor.rules is not None and corridor.rules.closed[vehicle.lane - 1, first : last + 1].any():
            remedy = (
                f"lane {vehicle.lane} is closed to motor vehicles over {station.low:g} to {station.high:g} m"
            )
            raise ScenarioError(source, key, vehicle.lane, remedy)
    for i, start in enumerate(scenario.fixed.starts if scenario.fixed else ()):
        if not 0.0 <= start.station_m <= corridor.length_m:
            key, remedy = f"fixed.starts[{i}].station_m", f"the road goes from 0 to {corridor.length_m:.0f} m"
            raise ScenarioError(source, key, start.station_m, remedy)
    _check_side_by_side(scenario, source, corridor)
    return corridor


def _key(vehicle: Vehicle, index: int, key: str) -> str:
    return f"start.{key}" if getattr(vehicle, key) is None else f"vehicles[{index}].{key}"


def _check_distribution(dist: Distribution, kind: str, key: str, refuse: Refuse) -> None:
    if isinstance(dist, Beta):
        for name in ("alpha", "beta"):
            if not 0.0 < getattr(dist, name) <= 1000.0:
                refuse(f"{key}.{name}", getattr(dist, name), "Beta parameters lie above 0 and at most 1000")
    if not dist.low < dist.high:
        refuse(f"{key}.low", dist.low, f"low must lie below high ({dist.high:g})")
    if isinstance(dist, TruncatedNormal):
        if not dist.deviation > 0.0:
            refuse(f"{key}.deviation", dist.deviation, "a standard deviation lies above 0")
        if not dist.low - 6.0 * dist.deviation < dist.mean < dist.high + 6.0 * dist.deviation:
            refuse(
                f"{key}.mean", dist.mean, f"more than six deviations outside {dist.low:g} to {dist.high:g}"
            )
    if isinstance(dist, NormalMixture):
        if not 0.0 <= dist.share <= 1.0:
            refuse(f"{key}.share", dist.share, "a probability lies between 0 and 1")
        if not 0.0 < dist.narrow <= dist.wide:
            refuse(f"{key}.narrow", dist.narrow, f"give above 0, up to `wide` ({dist.wide:g})")
    if kind in PLAUSIBLE:
        low, high, remedy = PLAUSIBLE[kind]
        for end in ("low", "high"):
            if not low <= getattr(dist, end) <= high:
                refuse(f"{key}.{end}", getattr(dist, end), remedy)


def _check_noise_mode(scenario: Scenario, refuse: Refuse) -> None:
    if scenario.drivers.noise_mode == "searched" and scenario.action_noise_values > MAX_SEARCHED:
        refuse(
            "drivers.noise_mode",
            "searched",
            f"its {scenario.action_noise_values} values are more than the {MAX_SEARCHED} a search takes; "
            "shorten the horizon, or leave the noise mode at drawn",
        )


def _check_fixed(scenario: Scenario, fixed: Fixed, refuse: Refuse) -> None:
    try:
        noise_of(fixed.noise_seed)
    except InputError as error:
        refuse("fixed.noise_seed", fixed.noise_seed[:80], f"{error}; as text, in quotes")
    given, wanted = [s.name for s in fixed.starts], [v.name for v in scenario.vehicles]
    if sorted(given) != sorted(wanted):
        refuse("fixed.starts", given, f"give one start for each vehicle: {', '.join(wanted)}")
    for i, start in enumerate(fixed.starts):
        for key, (low, high, remedy) in PLAUSIBLE.items():
            if key not in scenario.start_names:
                continue
            if getattr(start, key) is None:
                refuse(f"fixed.starts[{i}].{key}", None, "missing; the scenario draws this value")
            if not low <= getattr(start, key) <= high:
                refuse(f"fixed.starts[{i}].{key}", getattr(start, key), remedy)
    if len(fixed.driver_weights) != HEAD_SIZE:
        refuse("fixed.driver_weights", len(fixed.driver_weights), f"give {HEAD_SIZE} numbers")


def _check_overlaps(scenario: Scenario, source: str) -> None:
    """Refuse two vehicles in one lane whose boxes could overlap at the start."""
    for j, b in enumerate(scenario.vehicles):
        for a in scenario.vehicles[:j]:
            if a.lane != b.lane:
                continue
            sa, sb = scenario.of(a, "station_m"), scenario.of(b, "station_m")
            room = 0.5 * (scenario.of(a, "length_m") + scenario.of(b, "length_m"))
            if sa.low - room < sb.high and sb.low - room < sa.high:
                raise ScenarioError(
                    source,
                    f"vehicles[{j}].station_m",
                    f"{sb.low:g} to {sb.high:g}",
                    f"{b.name} can start on top of {a.name}, which starts at {sa.low:g} to {sa.high:g} m in the same "
                    f"lane {a.lane}; keep the ranges {room:g} m apart or use another lane",
                )


def _check_side_by_side(scenario: Scenario, source: str, corridor: Corridor) -> None:
    """Refuse two vehicles of different lanes whose boxes could overlap at the start."""
    for j, b in enumerate(scenario.vehicles):
        for a in scenario.vehicles[:j]:
            room = 0.5 * (scenario.of(a, "length_m") + scenario.of(b, "length_m"))
            sa, sb = scenario.of(a, "station_m"), scenario.of(b, "station_m")
            if a.lane == b.lane or sa.low - room >= sb.high or sb.low - room >= sa.high:
                continue
            stations = np.arange(math.floor(min(sa.low, sb.low)), max(sa.high, sb.high) + 1.0, corridor.ds_m)
            between = corridor.lane_center(a.lane - 1, stations) - corridor.lane_center(b.lane - 1, stations)
            low_a, high_a = _reach_m(scenario, a)
            low_b, high_b = _reach_m(scenario, b)
            if ((between + low_a < high_b) & (between + high_a > low_b)).any():
                offset = scenario.of(b, "lane_offset_m")
                raise ScenarioError(
                    source,
                    _key(b, j, "lane_offset_m"),
                    f"{offset.low:g} to {offset.high:g}",
                    f"{b.name} in lane {b.lane} can start on top of {a.name} in lane {a.lane}; narrow the lane offsets "
                    "or headings, or keep the stations apart",
                )


def _reach_m(scenario: Scenario, vehicle: Vehicle) -> tuple[float, float]:
    """How far the vehicle's box can reach to the right (negative) and left of its lane's centre at the start."""
    turned = steepest(scenario, vehicle)
    length, width = scenario.of(vehicle, "length_m"), scenario.of(vehicle, "width_m")
    half = 0.5 * (width * math.cos(turned) + length * math.sin(turned))
    offset = scenario.of(vehicle, "lane_offset_m")
    return offset.low - half, offset.high + half
