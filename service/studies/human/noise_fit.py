"""Fit of the drivers' action noise to recordings: its correlation times and its amplitudes.

Correlation times. The noise's correlation after t is (1 + t / T) exp(-t / T). T of the acceleration is such that it
is the recorded accelerations' correlation after 1 s; T of the turn rate such that it is the recorded lateral
accelerations'.

Amplitudes. Rollouts of a scenario that starts as recorded (`i80-data`), after SETTLE_S, are smoothed as the recordings
are; the amplitude of the acceleration's noise is where their jerk has the recorded standard deviation, that of the turn
rate's where their lateral speed has. Both have the same draws at every amplitude, so that bisection finds it. Only
training vehicles are looked at.
"""

import math
from dataclasses import dataclass
from pathlib import Path

import msgspec
import numpy as np
from scipy.optimize import brentq

import ce
from policies.data.scenes import Scene, read_i80
from policies.data.smoothing import LATERAL_CUTOFF_HZ, LONGITUDINAL_CUTOFF_HZ, derivative, smooth
from policies.drivers import load_drivers
from policies.egos.idm import DESIRED_SPEED_MPS
from policies.idm import idm_action
from service.world import agents as A
from service.world.scenario.base import base_distribution
from service.world.scenario.schema import Avoidance, Glances, Human, NoiseProcess, Reaction, Scenario
from service.world.sim.human import traits_of
from service.world.sim.road import road_of
from service.world.sim.rollout import Draw
from service.world.sim.step import RUNNING
from service.world.sim.world import DriverNetwork, World
from sumo_nets.corridor import load_corridor

LAG_S = 1.0
DT_S = 0.1
SETTLE_S = 5.0
DRIVE_S = 15.0
LEAST_S = 6.0  # of a recorded track
LARGEST = 1.0  # amplitude: the network's own answer
HALVINGS = 7


@dataclass(frozen=True)
class Movement:
    """How vehicles move: standard deviations of lateral speed (m/s), jerk (m/s^3), acceleration and lateral
    acceleration (m/s^2), and the correlations of the last two after LAG_S; tracks: of how many."""

    lateral_mps: float
    jerk_mps3: float
    acceleration_mps2: float
    lateral_acceleration_mps2: float
    acceleration_correlation: float
    lateral_acceleration_correlation: float
    tracks: int


def movement(tracks: list[tuple[np.ndarray, np.ndarray]]) -> Movement:
    """Of tracks of (speed along, speed across), smoothed, at DT_S."""
    lag = round(LAG_S / DT_S)
    along = [derivative(v) for v, _ in tracks]
    across = [derivative(u) for _, u in tracks]
    jerk = np.concatenate([np.diff(a) / DT_S for a in along])
    return Movement(
        float(np.concatenate([u for _, u in tracks]).std()),
        float(jerk.std()),
        float(np.concatenate(along).std()),
        float(np.concatenate(across).std()),
        _correlation(along, lag),
        _correlation(across, lag),
        len(tracks),
    )


def _correlation(series: list[np.ndarray], lag: int) -> float:
    a, b = np.concatenate([s[:-lag] for s in series]), np.concatenate([s[lag:] for s in series])
    return float(np.corrcoef(a, b)[0, 1])


def recorded(data: Path) -> Movement:
    """Of the training vehicles of the data pack's I-80 scene. Raises DataError where it is missing or wrong."""
    return movement(_tracks(read_i80(data)))


def _tracks(scene: Scene) -> list[tuple[np.ndarray, np.ndarray]]:
    found = []
    for v in np.flatnonzero(scene.vehicle_id < scene.held_out_from):
        use = scene.usable[:, v] & (scene.lane[:, v] < 6)
        ends = np.flatnonzero(np.diff(np.concatenate([[0], use.astype(np.int8), [0]])))
        for a, b in zip(ends[::2], ends[1::2], strict=True):
            if (b - a) * DT_S >= LEAST_S:
                speed, heading = scene.speed[a:b, v], scene.heading[a:b, v]
                found.append((speed * np.cos(heading), speed * np.sin(heading)))
    return found


def correlation_time(correlation: float) -> float:
    """T in s, such that (1 + t / T) exp(-t / T) is the correlation after t = LAG_S."""
    x = brentq(lambda x: (1.0 + x) * math.exp(-x) - min(max(correlation, 0.01), 0.99), 1e-3, 20.0)
    return LAG_S / x


def with_noise(scenario: Scenario, noise: NoiseProcess) -> Scenario:
    """The scenario with human drivers that have this noise, everybody looking at the road."""
    human = Human(
        glances=Glances(epsilon=0.0, every_s=1e6), noise=noise, avoidance=Avoidance(), reaction=Reaction()
    )
    time = msgspec.structs.replace(scenario.time, horizon_s=SETTLE_S + DRIVE_S)
    return msgspec.structs.replace(scenario, human=human, time=time)


def driven(scenario: Scenario, rollouts: int, seed: int = 1) -> Movement:
    """Of the environment vehicles of that many rollouts after SETTLE_S, smoothed as the recordings are; the ego is the
    intelligent driver."""
    drivers = load_drivers(scenario.drivers.weights)
    road = road_of(load_corridor(scenario.network.road))
    world = World(
        road,
        DriverNetwork.of(drivers),
        len(scenario.vehicles),
        scenario.ego,
        DT_S,
        traits=traits_of(scenario),
    )
    draw = Draw(scenario)
    x, seeds = ce.draw(base_distribution(scenario, drivers), seed, "estimate", 0, 0, rollouts)
    tracks, first = [], round(SETTLE_S / DT_S)
    for k in range(rollouts):
        _, happens = draw.begin(world, x[k], int(seeds[k]))
        trace = np.full((len(happens), world.vehicles, 3), np.nan)
        status, _ = world.observe()
        for t in range(len(happens)):
            if status != RUNNING:
                break
            acceleration, turn_rate = idm_action(world.observations[world.ego], DESIRED_SPEED_MPS)
            world.advance(acceleration, turn_rate, happens[t])
            status, _ = world.observe()
            state = world.agents[:, [A.SPEED_MPS, A.LANE_HEADING_RAD, A.LANE]]
            trace[t] = np.where(
                world.agents[:, [A.ACTIVE]] * (1 - world.agents[:, [A.TAKEN_OVER]]) > 0, state, np.nan
            )
        for v in range(world.vehicles):
            here = trace[first:, v]
            if v != world.ego and np.isfinite(here).all():
                tracks.append((here[:, 0] * np.cos(here[:, 1]), here[:, 0] * np.sin(here[:, 1])))
    return movement([_smoothed(v, u) for v, u in tracks])


def _smoothed(along: np.ndarray, across: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    def one(speed: np.ndarray, cutoff_hz: float) -> np.ndarray:
        return derivative(smooth(np.concatenate([[0.0], np.cumsum(speed) * DT_S]), cutoff_hz))[1:]

    return one(along, LONGITUDINAL_CUTOFF_HZ), one(across, LATERAL_CUTOFF_HZ)


def fitted(
    scenario: Scenario, target: Movement, rollouts: int, seed: int = 1, modes: int = 2
) -> tuple[NoiseProcess, Movement]:
    """The noise whose rollouts of `scenario` move as the recordings, and how they do.

    The two amplitudes are bisected in turn, as they hardly depend on each other: acceleration, turn rate, and both
    again.
    """
    noise = NoiseProcess(
        acceleration_amplitude=0.5,
        acceleration_correlation_s=round(correlation_time(target.acceleration_correlation), 3),
        turn_rate_amplitude=0.2,
        turn_rate_correlation_s=round(correlation_time(target.lateral_acceleration_correlation), 3),
        modes=modes,
    )
    for _ in range(2):
        for key, quantity in (
            ("turn_rate_amplitude", "lateral_mps"),
            ("acceleration_amplitude", "jerk_mps3"),
        ):
            low, high = 0.0, LARGEST
            for _ in range(HALVINGS):
                middle = 0.5 * (low + high)
                noise = msgspec.structs.replace(noise, **{key: middle})
                found = driven(with_noise(scenario, noise), rollouts, seed)
                low, high = (
                    (middle, high) if getattr(found, quantity) < getattr(target, quantity) else (low, middle)
                )
            noise = msgspec.structs.replace(noise, **{key: round(0.5 * (low + high), 3)})
    return noise, driven(with_noise(scenario, noise), rollouts, seed)
