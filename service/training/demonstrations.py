"""Rows to learn from: observations with the action a driver took there, and where each row comes from.

Three kinds of rows:

recorded    what a recorded driver saw and did (smoothed actions).
perturbed   the same driver moved off its recorded motion (noise injection, Laskey et al. 2017): a little to the
            side, turned, faster or slower, closer to or further from its leader. Its label is the recorded action plus
            the correction that rejoins the recorded motion, critically damped. Without such rows an imitator
            never sees the consequences of its own small errors and drifts away.
aggregated  states that the networks themselves reach on the I-80 road from the scenario's starts, where the
            recordings have hardly anything (fast, almost empty), labelled by the fitted expert (expert.py).
"""

from dataclasses import dataclass, replace

import numpy as np

from policies import layout as O
from policies.columns import Columns
from policies.data.scenes import Scene
from service.training.world import BEAM_TABLE, observe_recorded
from service.world.sim.road import scene_road

RECORDED, PERTURBED, AGGREGATED = 0, 1, 2

# Standard deviations of the injected displacement: metres ahead, metres to the left, radians, m/s.
INJECTED_SD = np.array([1.5, 0.35, 0.015, 0.7])
INJECTED_AHEAD_LIMIT_M = 0.3  # at most this share of the gap ahead
LATERAL_RATE_PER_S = 0.5  # critically damped return with time constant 1/0.5 = 2 s
LONGITUDINAL_RATE_PER_S = 0.3
SPEED_FLOOR_MPS = 4.0


@dataclass(frozen=True)
class Rows(Columns):
    """n rows.

    seen: (n, 51) float32
    action: (n, 2) m/s^2, rad/s
    kind: (n,)
    trajectory: (n,) unique number of the driver's track (for resampling whole trajectories)
    held_out: (n,) bool
    """

    seen: np.ndarray
    action: np.ndarray
    kind: np.ndarray
    trajectory: np.ndarray
    held_out: np.ndarray


def joined(parts: list[Rows]) -> Rows:
    """All rows of `parts`; trajectory numbers are made unique."""
    offset, unique = 0, []
    for part in parts:
        unique.append(replace(part, trajectory=part.trajectory + offset))
        offset += int(part.trajectory.max(initial=-1)) + 1
    return Rows.joined(unique)


def held_out_vehicles(scene: Scene) -> np.ndarray:
    """(N,) bool: vehicles kept from training."""
    return scene.vehicle_id >= scene.held_out_from


def recorded_rows(scene: Scene) -> Rows:
    """Every usable row of a scene as its driver saw it."""
    frame, vehicle = np.nonzero(scene.usable)
    return _rows(scene, frame, vehicle, np.zeros((len(frame), 4)), RECORDED)


def perturbed_rows(scene: Scene, rng: np.random.Generator, share: float = 1.0) -> Rows:
    """`share` of the usable rows with injected displacements and corrected actions."""
    frame, vehicle = np.nonzero(scene.usable)
    pick = np.sort(rng.choice(len(frame), round(share * len(frame)), replace=share > 1.0))
    frame, vehicle = frame[pick], vehicle[pick]
    shift = rng.normal(0.0, 1.0, (len(pick), 4)) * INJECTED_SD
    gap = _gap_ahead(scene, frame, vehicle)
    shift[:, 0] = np.clip(shift[:, 0], -INJECTED_AHEAD_LIMIT_M * gap, INJECTED_AHEAD_LIMIT_M * gap)
    speed = scene.speed[frame, vehicle]
    shift[:, 3] = np.maximum(shift[:, 3], -speed)
    return _rows(scene, frame, vehicle, shift, PERTURBED)


def correction(shift: np.ndarray, speed: np.ndarray) -> np.ndarray:
    """Action (n, 2) that takes a vehicle displaced by `shift` (n, 4) back to its motion, critically damped."""
    lateral, longitudinal = LATERAL_RATE_PER_S, LONGITUDINAL_RATE_PER_S
    v = np.maximum(speed + shift[:, 3], SPEED_FLOOR_MPS)
    accel = -(longitudinal**2) * shift[:, 0] - 2.0 * longitudinal * shift[:, 3]
    sideways = -(lateral**2) * shift[:, 1] - 2.0 * lateral * v * np.sin(shift[:, 2])
    return np.column_stack([accel, sideways / v])


def _rows(scene: Scene, frame: np.ndarray, vehicle: np.ndarray, shift: np.ndarray, kind: int) -> Rows:
    road = scene_road(scene.road)
    state = np.stack([scene.x, scene.y, scene.heading, scene.speed], axis=-1)
    size = np.column_stack([scene.length_m, scene.width_m])
    seen = np.zeros((len(frame), O.OBSERVATION_SIZE))
    observe_recorded(
        state, size, scene.present, frame, vehicle, shift, road.reference, road.lanes, road.spacing_m,
        BEAM_TABLE, seen,
    )  # fmt: skip
    action = np.column_stack([scene.accel[frame, vehicle], scene.turn_rate[frame, vehicle]])
    action += correction(shift, scene.speed[frame, vehicle])
    action[:, 0] = np.clip(action[:, 0], -O.MAX_DECELERATION_MPS2, O.MAX_ACCELERATION_MPS2)
    return Rows(
        seen.astype(np.float32),
        action.astype(np.float32),
        np.full(len(frame), kind, dtype=np.int8),
        vehicle.astype(np.int64),
        held_out_vehicles(scene)[vehicle],
    )


def _gap_ahead(scene: Scene, frame: np.ndarray, vehicle: np.ndarray) -> np.ndarray:
    """Bumper distance (m) to the next vehicle ahead in the same lane, 30 at most."""
    gap = np.empty(len(frame))
    for f in np.unique(frame):
        rows = np.flatnonzero(frame == f)
        s, lane = scene.station[f], scene.lane[f]
        for i in rows:
            me = vehicle[i]
            ahead = (lane == lane[me]) & (s > s[me])
            free = s[ahead] - s[me] - 0.5 * (scene.length_m[ahead] + scene.length_m[me])
            gap[i] = min(max(free.min(initial=30.0), 0.5), 30.0)
    return gap
