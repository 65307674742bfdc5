"""The base distribution P0 of a scenario, and what a draw from it means to the world."""

import math
from dataclasses import dataclass

import numpy as np

import ce
from policies.drivers import DriverModel
from policies.exactmath import arcsine, exp, log, sincos
from policies.layout import HEAD_SIZE
from service.world.scenario.causes import cause_names, causes_of, marginals_of_causes
from service.world.scenario.schema import (
    Beta,
    Distribution,
    NormalMixture,
    RandomWeather,
    Scenario,
    Uniform,
)

Marginal = ce.Beta | ce.Uniform | ce.TruncatedNormal | ce.TwoNormals
WEATHER = RandomWeather.__struct_fields__
STARTS = 4  # S, T, W, V of the paper for each vehicle; `Scenario.start_names` has their names


@dataclass(frozen=True)
class Start:
    """Where a vehicle starts."""

    station_m: float
    lane: int  # 0 is the leftmost
    lane_offset_m: float
    lane_heading_rad: float
    speed_mps: float
    length_m: float
    width_m: float


def base_distribution(scenario: Scenario, drivers: DriverModel) -> ce.Product:
    """P0 of X = (S, T, W, V of each vehicle, xi): dimension 4 vehicles + 404 (paper, section 4).

    A scenario with weather has its five coordinates before xi, then come those of the drivers' causes
    (`service.world.scenario.causes`) where it has a human table; one with noise_mode = "searched" has the action noise
    after it, standard normals (steps, vehicles, channels).
    """
    blocks: list[Marginal | ce.Marginal | ce.Normal] = []
    names: list[str] = []
    for vehicle in scenario.vehicles:
        for key in scenario.start_names:
            blocks.append(marginal(scenario.of(vehicle, key)))
            names.append(f"{vehicle.name}.{key}")
    if scenario.weather is not None:
        for key in WEATHER:
            blocks.append(marginal(getattr(scenario.weather, key)))
            names.append(f"weather.{key}")
    blocks += marginals_of_causes(scenario)
    names += cause_names(scenario)
    blocks.append(ce.Normal(drivers.mu0, drivers.sigma0))
    names += [f"xi[{i}]" for i in range(HEAD_SIZE)]
    if scenario.drivers.noise_mode == "searched":
        blocks.append(ce.StandardNormal(scenario.action_noise_values))
        names += [
            f"{vehicle.name}.{action}_noise[{k}]"
            for k in range(scenario.steps)
            for vehicle in scenario.vehicles
            for action in ("acceleration", "turn_rate", "glance", "leak")[: scenario.noise_channels]
        ]
    return ce.Product(blocks, names)


def dimension(scenario: Scenario) -> int:
    """Of the base distribution, without making it."""
    searched = scenario.action_noise_values if scenario.drivers.noise_mode == "searched" else 0
    return before_weights(scenario) + HEAD_SIZE + searched


def marginal(dist: Distribution) -> Marginal:
    """The distribution as a block of the base distribution."""
    if isinstance(dist, Beta):
        return ce.Beta(dist.alpha, dist.beta, dist.low, dist.high)
    if isinstance(dist, Uniform):
        return ce.Uniform(dist.low, dist.high)
    if isinstance(dist, NormalMixture):
        return ce.TwoNormals(dist.share, dist.narrow, dist.wide, dist.low, dist.high)
    return ce.TruncatedNormal(dist.mean, dist.deviation, dist.low, dist.high)


def unpack(scenario: Scenario, x: np.ndarray) -> tuple[list[Start], np.ndarray]:
    """The starts and the driver weights xi (404,) that a draw x (d,) stands for."""
    starts = []
    for i, vehicle in enumerate(scenario.vehicles):
        station, offset, third, speed = x[STARTS * i : STARTS * (i + 1)].tolist()
        starts.append(
            Start(
                station_m=station,
                lane=vehicle.lane - 1,
                lane_offset_m=offset,
                lane_heading_rad=_heading_rad(scenario, offset, third, speed),
                speed_mps=speed,
                length_m=scenario.of(vehicle, "length_m"),
                width_m=scenario.of(vehicle, "width_m"),
            )
        )
    first = before_weights(scenario)
    return starts, x[first : first + HEAD_SIZE]


def _heading_rad(scenario: Scenario, offset_m: float, drawn: float, speed_mps: float) -> float:
    """Relative to the lane: as drawn, or such that the vehicle has the lateral speed drawn (`schema.Start`)."""
    if scenario.start.lateral_mps is None:
        return drawn * (math.pi / 180.0)
    if speed_mps <= 0.0:
        return 0.0
    most, _ = sincos(scenario.start.lateral_steepest_deg * (math.pi / 180.0))
    return arcsine(min(max(lateral_speed(scenario, offset_m, drawn, speed_mps) / speed_mps, -most), most))


def lateral_speed(scenario: Scenario, offset_m: float, drawn: float, speed_mps: float) -> float:
    """The speed across the lane, in m/s, that a drawn `lateral_mps` means for a vehicle there at that speed."""
    start = scenario.start
    slow = min(1.0, speed_mps / start.lateral_full_mps)
    # the power by exact arithmetic: the same bits on every processor
    slowed = exp(start.lateral_speed_power * log(slow)) if slow > 0.0 else 0.0
    return drawn * (1.0 + start.lateral_offset_gain * offset_m * offset_m) * slowed


def causes(scenario: Scenario, x: np.ndarray) -> np.ndarray:
    """The drivers' causes that a draw x (d,) holds: (vehicles, columns of `service.world.scenario.causes`)."""
    last = before_weights(scenario)
    return causes_of(scenario, x[last - len(cause_names(scenario)) : last])


def searched_action_noise(scenario: Scenario, x: np.ndarray) -> np.ndarray:
    """The action noise (steps, vehicles, channels) that a draw x (d,) of a scenario with noise_mode = "searched"
    holds."""
    normals = x[before_weights(scenario) + HEAD_SIZE :]
    return np.ascontiguousarray(normals, dtype=np.float64).reshape(
        scenario.steps, len(scenario.vehicles), scenario.noise_channels
    )


def weather_values(scenario: Scenario, x: np.ndarray) -> dict[str, float]:
    """Light and weather that a draw x (d,) stands for, by their names in the scenario; empty where it has none."""
    if scenario.weather is None:
        return {}
    begin = STARTS * len(scenario.vehicles)
    return dict(zip(WEATHER, x[begin : begin + len(WEATHER)].tolist(), strict=True))


def before_weights(scenario: Scenario) -> int:
    """How many coordinates of X come before xi."""
    weather = 0 if scenario.weather is None else len(WEATHER)
    return STARTS * len(scenario.vehicles) + weather + len(cause_names(scenario))
