"""Recorded scenes with some of their vehicles driven by a model: the world's own kernels, without SUMO.

Nothing ends and nobody is taken over at a contact: a model that touches somebody drives on, as in the published
evaluations (README of policies/realism). A vehicle that runs past the end of the road goes on straight at its speed.
"""

from dataclasses import dataclass

import numpy as np

from policies import layout
from policies.baselines.idm_mobil import (
    ARRIVED_M,
    PARAMETERS,
    behind,
    beside,
    change_rate,
    incentive,
    steering,
)
from policies.data.scenes import Scene
from policies.drivers import DriverModel
from policies.jit import kernel
from policies.network import forward, sample_action
from policies.realism.driven import Driven, driven_scene
from service.studies.realism.people import UNNEEDED, advance_people, people
from service.world import agents as A
from service.world.scenario.schema import Scenario
from service.world.sensors.lidar import beam_directions
from service.world.sim.dynamics import advance
from service.world.sim.road import Road, scene_road
from service.world.sim.step import NO_EGO, observe

NETWORK, IDM_MOBIL, CONSTANT, HUMAN = range(4)
BEAMS = beam_directions(layout.BEAMS)


@dataclass(frozen=True)
class Model:
    """What drives: kind, the network's weights with a distribution of heads, or IDM+MOBIL's PARAMETERS (12,).

    human: of kind HUMAN, a scenario whose human table stands around the network
    """

    name: str
    kind: int
    drivers: DriverModel | None = None
    values: np.ndarray | None = None
    human: Scenario | None = None


@kernel
def drive(
    kind: int, agents: np.ndarray, controlled: int, steps: int, w1: np.ndarray, b1: np.ndarray, w2: np.ndarray,
    b2: np.ndarray, head: np.ndarray, action_scale: np.ndarray, p: np.ndarray, last_lane: int,
    action_noise: np.ndarray, chance: np.ndarray, reference: np.ndarray, lanes: np.ndarray, spacing_m: float,
    beams: np.ndarray, replay: np.ndarray, happens: np.ndarray, minds: np.ndarray, traits: np.ndarray,
    out: np.ndarray,
) -> None:  # fmt: skip
    """Drive the first `controlled` rows of `agents` for `steps` of 0.1 s; the rest follow `replay`.

    action_noise: (steps, controlled, 2) standard normals
    chance: (steps, controlled, 2) uniforms
    replay: (steps + 1, rows, 7) x, y, heading, speed, station m, lane, acceleration; NaN where absent
    happens, minds, traits: of HUMAN drivers, see `service.studies.realism.people`
    out: (steps + 1, controlled, 5) station, offset, speed, acceleration, turn rate
    """
    count = agents.shape[0]
    seen = np.zeros((controlled, layout.OBSERVATION_SIZE))
    outputs = np.empty(layout.OUTPUTS, np.float32)
    wanted = np.full(controlled, -1, np.int64)
    station, speed, length = np.zeros(count), np.zeros(count), agents[:, A.LENGTH_M].copy()
    lane, present = np.zeros(count, np.int64), np.zeros(count, np.bool_)
    poses = np.zeros((controlled, 4))
    for t in range(steps + 1):
        for r in range(count - controlled):
            row = agents[controlled + r]
            here = not np.isnan(replay[t, r, 0])
            row[A.ACTIVE] = 1.0 if here else 0.0
            if here:
                for c in range(4):
                    row[A.X_M + c] = replay[t, r, c]
                station[controlled + r] = replay[t, r, 4]
                lane[controlled + r] = int(replay[t, r, 5])
                row[A.ACCELERATION_MPS2] = replay[t, r, 6]
        observe(agents, controlled, count, NO_EGO, reference, lanes, spacing_m, beams, beams, seen)
        for i in range(count):
            agent = agents[i]
            present[i] = agent[A.ACTIVE] != 0.0
            speed[i] = agent[A.SPEED_MPS]
            if i < controlled:
                lane[i] = int(agent[A.LANE])
                if present[i]:
                    station[i] = agent[A.STATION] * spacing_m + agent[A.ALONG_M]
                else:  # past the end of the road
                    station[i] += 0.1 * speed[i]
        if kind == HUMAN and t < steps:
            for i in range(controlled):
                out[t, i, 0], out[t, i, 1], out[t, i, 2] = (
                    station[i],
                    agents[i, A.OFFSET_M],
                    agents[i, A.SPEED_MPS],
                )
            advance_people(
                agents, controlled, count, seen, w1, b1, w2, b2, head, action_scale, happens[t], reference, lanes,
                spacing_m, minds, traits, poses,
            )  # fmt: skip
            for i in range(controlled):
                out[t, i, 3], out[t, i, 4] = agents[i, A.ACCELERATION_MPS2], agents[i, A.TURN_RATE_RADPS]
            continue
        for i in range(controlled):
            agent = agents[i]
            out[t, i, 0], out[t, i, 1], out[t, i, 2] = station[i], agent[A.OFFSET_M], agent[A.SPEED_MPS]
            if t == steps:
                continue
            a, w = 0.0, agent[A.SPEED_MPS] * agent[A.CURVATURE_PER_M]
            if not present[i]:
                w = 0.0
            elif kind == NETWORK:
                forward(seen[i], w1, b1, w2, b2, head, outputs)
                a, w = sample_action(outputs, action_scale, action_noise[t, i, 0], action_noise[t, i, 1])
            elif kind == IDM_MOBIL:
                a, w = idm_mobil_step(
                    p, agent, i, station, lane, speed, length, present, last_lane, wanted, chance[t, i], lanes,
                )  # fmt: skip
            advance(agent, a, w, 0.1, False)
            out[t, i, 3], out[t, i, 4] = agent[A.ACCELERATION_MPS2], agent[A.TURN_RATE_RADPS]


@kernel
def idm_mobil_step(
    p: np.ndarray, agent: np.ndarray, i: int, station: np.ndarray, lane: np.ndarray, speed: np.ndarray,
    length: np.ndarray, present: np.ndarray, last_lane: int, wanted: np.ndarray, chance: np.ndarray,
    lanes: np.ndarray,
) -> tuple[float, float]:  # fmt: skip
    """Acceleration and turn rate; updates the lane that is wanted."""
    here = lane[i]
    if wanted[i] < 0:
        wanted[i] = here
    k = int(agent[A.STATION])
    centre = 0.5 * (lanes[k, wanted[i], 0] + lanes[k, wanted[i], 1])
    if abs(agent[A.OFFSET_M] - centre) < ARRIVED_M:
        for side in range(2):
            to_lane = here + (1 if side == 1 else -1)
            if to_lane < 1 or to_lane > last_lane or here > last_lane:  # lane 1 (0) is reserved, and the ramp
                continue
            own, others, allowed = incentive(p, station, lane, speed, length, present, i, to_lane)
            if allowed and chance[side] < 0.1 * change_rate(p, own, others, side == 1):
                wanted[i] = to_lane
                centre = 0.5 * (lanes[k, to_lane, 0] + lanes[k, to_lane, 1])
                break
    lead, _ = beside(station, lane, present, i, here)
    a = behind(p, station, speed, length, i, lead)
    if wanted[i] != here:
        lead, _ = beside(station, lane, present, i, wanted[i])
        a = min(a, behind(p, station, speed, length, i, lead))
    curvature, heading = agent[A.CURVATURE_PER_M], agent[A.LANE_HEADING_RAD]
    return a, steering(p, agent[A.SPEED_MPS], agent[A.OFFSET_M] - centre, heading, curvature)


NOBODY = DriverModel(
    np.zeros((layout.OBSERVATION_SIZE, layout.HIDDEN_1), np.float32), np.zeros(layout.HIDDEN_1, np.float32),
    np.zeros((layout.HIDDEN_1, layout.HIDDEN_2), np.float32), np.zeros(layout.HIDDEN_2, np.float32),
    np.zeros(layout.HEAD_SIZE), np.zeros((1, 1)), np.ones(2), {},
)  # fmt: skip


def drive_scene(
    model: Model, scene: Scene, road: Road, first: int, steps: int, who: np.ndarray, head: np.ndarray | None,
    rng: np.random.Generator,
) -> Driven:  # fmt: skip
    """Columns `who` of `scene` driven by `model` from row `first` on for `steps`.

    head (404,): of a network
    """
    rows = slice(first, first + steps + 1)
    others = np.flatnonzero(scene.present[rows].any(axis=0))
    others = others[~np.isin(others, who)]
    everyone = np.concatenate([who, others])
    agents = np.zeros((len(everyone), A.COLUMNS))
    agents[:, A.LENGTH_M], agents[:, A.WIDTH_M] = scene.length_m[everyone], scene.width_m[everyone]
    columns = [scene.x, scene.y, scene.heading, scene.speed, scene.station, scene.lane, scene.accel]
    state = np.stack(columns, axis=-1)[rows]
    n = len(who)
    agents[:n, A.X_M : A.SPEED_MPS + 1] = state[0, who, :4]
    agents[:n, A.STATION] = np.clip(np.round(state[0, who, 4] / road.spacing_m), 0, len(road.reference) - 1)
    agents[:n, A.ACTIVE] = 1.0
    drivers = model.drivers if model.drivers is not None else NOBODY
    weights = (drivers.mu0 if head is None else head).astype(np.float32)
    out = np.zeros((steps + 1, n, 5))
    happens, minds, traits = people(model.human, steps, n, rng) if model.human is not None else UNNEEDED
    drive(
        model.kind, agents, n, steps, drivers.w1, drivers.b1, drivers.w2, drivers.b2, weights,
        drivers.action_scale, model.values if model.values is not None else np.zeros(len(PARAMETERS)),
        road.lanes.shape[1] - 2, rng.standard_normal((steps, n, 2)), rng.random((steps, n, 2)), road.reference,
        road.lanes, road.spacing_m, BEAMS, np.ascontiguousarray(state[:, others]), happens,
        minds, traits, out,
    )  # fmt: skip
    return driven_scene(scene, first, who, *np.moveaxis(out, -1, 0))


def road_for(scene: Scene) -> Road:
    """The kernels' road of a scene."""
    return scene_road(scene.road)
