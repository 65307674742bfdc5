"""One step of the world as two compiled calls: `observe`, then (after the ego has acted) `advance_all`."""

import math

import numpy as np

from policies import layout
from policies.exactmath import sincos
from policies.idm import idm_action
from policies.jit import kernel
from policies.network import forward_all, sample_action
from service.world import agents as A
from service.world.safety.ttc import ego_time_to_collision
from service.world.sensors.lidar import scan
from service.world.sim.collision import mark_collisions
from service.world.sim.dynamics import advance
from service.world.sim.projection import locate

# how the rollout stands for the ego, or for all when there is none
RUNNING, FINISHED, COLLIDED, OFF_ROAD, REVERSED = range(5)

REVERSING_SPEED_MPS = -0.1  # slower than this is reversing; a stop may overshoot 0 by a step's deceleration
TAKEOVER_SPEED_MPS = 15.0  # desired speed of an environment vehicle that the lane-keeping driver took over
NO_EGO = -1


@kernel
def observe(
    agents: np.ndarray,
    controlled: int,
    count: int,
    ego: int,
    reference: np.ndarray,
    lanes: np.ndarray,
    spacing_m: float,
    beams: np.ndarray,
    rays: np.ndarray,
    observations: np.ndarray,
) -> tuple[int, float]:
    """Update what every controlled vehicle perceives; return how the ego stands and its time to collision (s).

    agents: (rows, COLUMNS), the first `controlled` rows are ours, the rest up to `count` background traffic.
    observations: (controlled, 51). `ego` is a row, or NO_EGO. An environment vehicle whose front reaches the end of
    the road leaves the world; when the ego's does, it has finished.
    """
    end_m = (reference.shape[0] - 1) * spacing_m
    status = RUNNING
    for i in range(count):
        sine, cosine = sincos(agents[i, A.HEADING_RAD])
        agents[i, A.SIN] = sine
        agents[i, A.COS] = cosine
    for i in range(controlled):
        agent = agents[i]
        if agent[A.ACTIVE] == 0.0:
            continue
        locate(agent, reference, lanes, spacing_m)
        agent[A.REVERSING] = 1.0 if agent[A.SPEED_MPS] < REVERSING_SPEED_MPS else 0.0
        if agent[A.STATION] * spacing_m + agent[A.ALONG_M] + 0.5 * agent[A.LENGTH_M] >= end_m:
            if i == ego:
                status = FINISHED
            else:
                agent[A.ACTIVE] = 0.0
    mark_collisions(agents, count)
    for i in range(controlled):
        agent = agents[i]
        if agent[A.ACTIVE] == 0.0:
            continue
        seen = observations[i]
        seen[layout.LANE_OFFSET_M] = agent[A.LANE_OFFSET_M]
        seen[layout.LANE_HEADING_RAD] = agent[A.LANE_HEADING_RAD]
        seen[layout.SPEED_MPS] = agent[A.SPEED_MPS]
        seen[layout.LENGTH_M] = agent[A.LENGTH_M]
        seen[layout.WIDTH_M] = agent[A.WIDTH_M]
        seen[layout.LANE_CURVATURE_PER_M] = agent[A.CURVATURE_PER_M]
        seen[layout.LEFT_MARKING_M] = agent[A.LEFT_MARKING_M]
        seen[layout.RIGHT_MARKING_M] = agent[A.RIGHT_MARKING_M]
        seen[layout.LANE_TO_THE_LEFT] = agent[A.LANE_TO_THE_LEFT]
        seen[layout.LANE_TO_THE_RIGHT] = agent[A.LANE_TO_THE_RIGHT]
        seen[layout.INCIDENT] = max(agent[A.COLLISION], agent[A.OFF_ROAD], agent[A.REVERSING])
        scan(
            agents,
            count,
            i,
            beams,
            layout.LIDAR_RANGE_M,
            seen[layout.RANGE_M : layout.RANGE_M + layout.BEAMS],
            seen[layout.RANGE_RATE_MPS : layout.RANGE_RATE_MPS + layout.BEAMS],
        )
    if ego < 0:
        return status, math.inf
    if agents[ego, A.COLLISION] != 0.0:
        status = COLLIDED
    elif agents[ego, A.OFF_ROAD] != 0.0:
        status = OFF_ROAD
    elif agents[ego, A.REVERSING] != 0.0:
        status = REVERSED
    ranges = np.empty(rays.shape[0])
    rates = np.empty(rays.shape[0])
    return status, ego_time_to_collision(agents, count, ego, rays, ranges, rates)


@kernel
def write_poses(agents: np.ndarray, controlled: int, lanes: int, poses: np.ndarray) -> None:
    """Fill `poses` (controlled, 4): front bumper x, y (m), heading as a compass angle (degrees), lane hint.

    That is how SUMO places vehicles. The hint is station * `lanes` + lane, as last located; -1 for a vehicle that has
    left the world.
    """
    for i in range(controlled):
        agent = agents[i]
        if agent[A.ACTIVE] == 0.0:
            poses[i, 3] = -1.0
            continue
        sine, cosine = sincos(agent[A.HEADING_RAD])
        poses[i, 0] = agent[A.X_M] + 0.5 * agent[A.LENGTH_M] * cosine
        poses[i, 1] = agent[A.Y_M] + 0.5 * agent[A.LENGTH_M] * sine
        poses[i, 2] = 90.0 - agent[A.HEADING_RAD] * (180.0 / math.pi)
        poses[i, 3] = agent[A.STATION] * lanes + agent[A.LANE]


@kernel
def network_driven(agents: np.ndarray, controlled: int, ego: int, rows: np.ndarray) -> int:
    """Fill `rows` (controlled + 1,) with those of the vehicles that the network drives in this step; how many."""
    count = 0
    for i in range(controlled):
        agent = agents[i]
        rows[count] = i
        if i != ego and agent[A.ACTIVE] != 0.0:
            lost = agent[A.COLLISION] != 0.0 or agent[A.OFF_ROAD] != 0.0 or agent[A.TAKEN_OVER] != 0.0
            count += 0 if lost else 1
    return count


@kernel
def advance_all(
    agents: np.ndarray,
    controlled: int,
    ego: int,
    ego_acceleration_mps2: float,
    ego_turn_rate_radps: float,
    observations: np.ndarray,
    w1: np.ndarray,
    b1: np.ndarray,
    w2: np.ndarray,
    b2: np.ndarray,
    head: np.ndarray,
    action_scale: np.ndarray,
    action_noise: np.ndarray,
    dt_s: float,
    lanes: int,
    poses: np.ndarray,
) -> None:
    """Move every active controlled vehicle by one step.

    Environment vehicles are driven by the network with `head` (404,) float32 and this step's standard normals
    `action_noise` (controlled, 2); one that has left the road or hit another is driven by the lane-keeping intelligent
    driver from then on. The ego does what its policy said and is never taken over. `poses`: see `write_poses`.
    """
    outputs = np.empty((controlled, layout.OUTPUTS), np.float32)
    rows = np.empty(controlled + 1, np.intp)
    driven = network_driven(agents, controlled, ego, rows)
    forward_all(observations, rows, driven, w1, b1, w2, b2, head, outputs)
    for i in range(controlled):
        agent = agents[i]
        if agent[A.ACTIVE] == 0.0:
            continue
        if i == ego:
            advance(agent, ego_acceleration_mps2, ego_turn_rate_radps, dt_s, True)
        else:
            if agent[A.COLLISION] != 0.0 or agent[A.OFF_ROAD] != 0.0:
                agent[A.TAKEN_OVER] = 1.0
            if agent[A.TAKEN_OVER] != 0.0:
                acceleration, turn_rate = idm_action(observations[i], TAKEOVER_SPEED_MPS)
            else:
                acceleration, turn_rate = sample_action(
                    outputs[i], action_scale, action_noise[i, 0], action_noise[i, 1]
                )
            advance(agent, acceleration, turn_rate, dt_s, False)
    write_poses(agents, controlled, lanes, poses)
