"""The world without SUMO, for training: the simulation's own kernels in one compiled loop.

Recorded scenes are shown to the networks through the very code that the simulation uses, and closed-loop
rollouts (for data set aggregation and for the metrics of the cards) run without SUMO.
"""

import itertools
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from policies import layout as O
from policies.drivers import DriverModel
from policies.jit import kernel
from policies.network import forward
from service.world import agents as A
from service.world.sensors.lidar import beam_directions
from service.world.sim.projection import place
from service.world.sim.road import Road
from service.world.sim.step import NO_EGO, advance_all, observe

BEAM_TABLE = beam_directions(O.BEAMS)
DT_S = 0.1


class Network(NamedTuple):
    """A network's weights as the kernels want them: float32, head (404,); action_scale (2,) float64."""

    w1: np.ndarray
    b1: np.ndarray
    w2: np.ndarray
    b2: np.ndarray
    head: np.ndarray
    action_scale: np.ndarray


def network_of(model: DriverModel) -> Network:
    """The network of stored weights, with the mean of its last layer."""
    head = model.mu0.astype(np.float32)
    return Network(model.w1, model.b1, model.w2, model.b2, head, model.action_scale)


def weights_of(network: Network, mean: np.ndarray, covariance: np.ndarray) -> dict[str, np.ndarray]:
    """The arrays of a weights file: the network with a last layer from N(mean (404,), covariance (404, 404))."""
    arrays = network._asdict()
    del arrays["head"]
    return {**arrays, "mu0": mean, "sigma0": covariance}


def drawn_from(
    network: Network, mean: np.ndarray, covariance: np.ndarray
) -> Callable[[np.random.Generator], Network]:
    """Draws of the network with a last layer from N(mean (404,), covariance (404, 404))."""
    root = np.linalg.cholesky(covariance)

    def draw(rng: np.random.Generator) -> Network:
        xi = mean + root @ rng.standard_normal(len(root))
        return network._replace(head=xi.astype(np.float32))

    return draw


@kernel
def observe_recorded(
    state: np.ndarray, size: np.ndarray, present: np.ndarray, which_frame: np.ndarray, which_vehicle: np.ndarray,
    shift: np.ndarray, reference: np.ndarray, lanes: np.ndarray, spacing_m: float, beams: np.ndarray,
    out: np.ndarray,
) -> None:  # fmt: skip
    """Observations (n, 51) of recorded vehicles, each moved by its row of `shift`.

    state: (F, N, 4) x, y, heading, speed
    size: (N, 2)
    present: (F, N)
    which_frame, which_vehicle: (n,)
    shift: (n, 4) metres ahead, metres to the left, radians, m/s

    The flag INCIDENT is left at 0: recorded drivers do none of it, only recorded boxes do.
    """
    vehicles = state.shape[1]
    agents = np.zeros((vehicles + 1, A.COLUMNS))
    stations = np.zeros(vehicles)
    seen = np.zeros((1, O.OBSERVATION_SIZE))
    for i in range(which_frame.shape[0]):
        frame = which_frame[i]
        own = which_vehicle[i]
        for v in range(vehicles):
            row = agents[v + 1]
            row[A.ACTIVE] = 1.0 if present[frame, v] and v != own else 0.0
            if present[frame, v]:
                for c in range(4):
                    row[A.X_M + c] = state[frame, v, c]
                row[A.LENGTH_M] = size[v, 0]
                row[A.WIDTH_M] = size[v, 1]
        me = agents[0]
        me[:] = agents[own + 1]
        me[A.ACTIVE] = 1.0
        me[A.STATION] = stations[own]
        sine, cosine = np.sin(me[A.HEADING_RAD]), np.cos(me[A.HEADING_RAD])
        me[A.X_M] += shift[i, 0] * cosine - shift[i, 1] * sine
        me[A.Y_M] += shift[i, 0] * sine + shift[i, 1] * cosine
        me[A.HEADING_RAD] += shift[i, 2]
        me[A.SPEED_MPS] = max(me[A.SPEED_MPS] + shift[i, 3], 0.0)
        seen[:] = 0.0
        observe(agents, 1, vehicles + 1, -1, reference, lanes, spacing_m, beams, beams, seen)
        stations[own] = me[A.STATION]
        out[i] = seen[0]
        out[i, O.INCIDENT] = 0.0


# columns of a rollout's trace
(T_STATION_M, T_OFFSET_M, T_LANE, T_LANE_OFFSET_M, T_SPEED_MPS, T_ACCELERATION, T_TURN_RATE, T_OFF_ROAD,
 T_COLLISION, T_TAKEN_OVER, T_ACTIVE, T_X_M, T_Y_M, T_HEADING) = range(14)  # fmt: skip
TRACE = 14


@kernel
def drive(
    agents: np.ndarray, controlled: int, ego: int, steps: int, w1: np.ndarray, b1: np.ndarray, w2: np.ndarray,
    b2: np.ndarray, head: np.ndarray, action_scale: np.ndarray, noise: np.ndarray, e1: np.ndarray, c1: np.ndarray,
    e2: np.ndarray, c2: np.ndarray, ego_head: np.ndarray, reference: np.ndarray, lanes: np.ndarray,
    spacing_m: float, beams: np.ndarray, observations: np.ndarray, trace: np.ndarray, ego_ttc: np.ndarray,
    replay: np.ndarray, stop_with_ego: bool,
) -> int:  # fmt: skip
    """Drive the first `controlled` vehicles for `steps` as the simulation does, without SUMO.

    The driver network (w1, b1, w2, b2, head) drives all but row `ego` (-1: none), which the mean action of the second
    network drives.

    noise: (steps, controlled, 2)

    Rows beyond `controlled` follow replay (steps, rows, 4): x, y, heading, speed, NaN where absent. Fills observations
    (steps, controlled, 51), trace (steps + 1, controlled, TRACE) and ego_ttc (steps + 1,) (s); row t of the trace is
    the state before step t. Returns the number of steps made: fewer when the ego has ended its rollout and
    `stop_with_ego`.
    """
    count = agents.shape[0]
    outputs = np.empty(O.OUTPUTS, np.float32)
    poses = np.zeros((controlled, 4))
    seen = np.zeros((controlled, O.OBSERVATION_SIZE))
    for t in range(steps + 1):
        for r in range(count - controlled):
            row = agents[controlled + r]
            k = min(t, replay.shape[0] - 1)
            row[A.ACTIVE] = 0.0 if np.isnan(replay[k, r, 0]) else 1.0
            if row[A.ACTIVE] != 0.0:
                for c in range(4):
                    row[A.X_M + c] = replay[k, r, c]
        status, ttc = observe(agents, controlled, count, ego, reference, lanes, spacing_m, beams, beams, seen)
        ego_ttc[t] = ttc
        any_active = False
        for v in range(controlled):
            row = trace[t, v]
            agent = agents[v]
            row[T_ACTIVE] = agent[A.ACTIVE]
            if agent[A.ACTIVE] == 0.0:
                continue
            any_active = True
            row[T_STATION_M] = agent[A.STATION] * spacing_m + agent[A.ALONG_M]
            row[T_OFFSET_M] = agent[A.OFFSET_M]
            row[T_LANE] = agent[A.LANE]
            row[T_LANE_OFFSET_M] = agent[A.LANE_OFFSET_M]
            row[T_SPEED_MPS] = agent[A.SPEED_MPS]
            row[T_OFF_ROAD] = agent[A.OFF_ROAD]
            row[T_COLLISION] = agent[A.COLLISION]
            row[T_TAKEN_OVER] = agent[A.TAKEN_OVER]
            row[T_X_M] = agent[A.X_M]
            row[T_Y_M] = agent[A.Y_M]
            row[T_HEADING] = agent[A.HEADING_RAD]
            if t < steps:
                observations[t, v] = seen[v]
        if t == steps or not any_active or (status != 0 and stop_with_ego):
            return t
        a = 0.0
        w = 0.0
        if ego >= 0:
            forward(seen[ego], e1, c1, e2, c2, ego_head, outputs)
            a = action_scale[0] * outputs[0]
            w = action_scale[1] * outputs[1]
        advance_all(
            agents, controlled, ego, a, w, seen, w1, b1, w2, b2, head, action_scale, noise[t], DT_S,
            lanes.shape[1], poses,
        )  # fmt: skip
        for v in range(controlled):
            trace[t, v, T_ACCELERATION] = agents[v, A.ACCELERATION_MPS2]
            trace[t, v, T_TURN_RATE] = agents[v, A.TURN_RATE_RADPS]
    return steps


@kernel
def _place_all(
    agents: np.ndarray, stations: np.ndarray, lane: np.ndarray, offsets: np.ndarray, headings: np.ndarray,
    reference: np.ndarray, lanes: np.ndarray, spacing_m: float,
) -> None:  # fmt: skip
    for v in range(agents.shape[0]):
        place(agents[v], stations[v], lane[v], offsets[v], headings[v], reference, lanes, spacing_m)


def standard_starts(
    rng: np.random.Generator, road: Road, vehicles: int = 6, wide: bool = False
) -> np.ndarray:
    """Agents (V, columns) as the i80 scenario's base distribution starts them, one a lane (leftmost first).

    S ~ 40 Beta(2,2) + 80 m, T ~ 0.5 Beta(2,2) - 0.25 m, W ~ 7.2 Beta(2,2) - 3.6 degrees, V ~ 10 Beta(2,2) + 10
    m/s. `wide`: harder and more varied starts for training only: anywhere on the road's first three quarters,
    lanes that may coincide, larger offsets and headings, 3 to 28 m/s.
    """
    agents = np.zeros((vehicles, A.COLUMNS))
    beta = rng.beta(2.0, 2.0, (4, vehicles))
    if wide:
        station = rng.uniform(20.0, 0.75 * road.length_m) + rng.uniform(0.0, 110.0, vehicles)
        exists = np.isfinite(road.lanes[np.clip(station.astype(int), 0, len(road.lanes) - 1), :, 0])
        lane = np.array([rng.choice(np.flatnonzero(row)) for row in exists])
        order = np.argsort(station)
        for a, b in itertools.pairwise(order):  # nobody starts inside another's box
            station[b] = max(station[b], station[a] + (8.0 if lane[a] == lane[b] else 1.0))
        offset, heading = rng.normal(0.0, 0.45, vehicles), rng.normal(0.0, 0.03, vehicles)
        speed = np.clip(rng.uniform(8.0, 24.0) + rng.normal(0.0, 3.0, vehicles), 1.0, 28.0)
    else:
        lane = np.arange(vehicles) % 6
        station, offset = 40.0 * beta[0] + 80.0, 0.5 * beta[1] - 0.25
        heading, speed = np.deg2rad(7.2 * beta[2] - 3.6), 10.0 * beta[3] + 10.0
    agents[:, A.SPEED_MPS] = speed
    agents[:, A.LENGTH_M] = rng.uniform(4.2, 5.2, vehicles) if wide else 4.5
    agents[:, A.WIDTH_M] = rng.uniform(1.75, 2.1, vehicles) if wide else 1.8
    agents[:, A.ACTIVE] = 1.0
    _place_all(
        agents, station, lane.astype(np.int64), offset, heading, road.reference, road.lanes, road.spacing_m
    )
    return agents


def rollout(
    agents: np.ndarray, road: Road, steps: int, drivers: Network, noise: np.ndarray, ego: int = NO_EGO,
    ego_network: Network | None = None, controlled: int | None = None, replay: np.ndarray | None = None,
    stop_with_ego: bool = True,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:  # fmt: skip
    """Drive `agents` (changed in place); returns observations, trace and the ego's time to collision (see drive).

    The arrays have as many rows as steps were made (the trace and the times one more).
    """
    controlled = len(agents) if controlled is None else controlled
    ego_network = drivers if ego_network is None else ego_network
    observations = np.zeros((steps, controlled, O.OBSERVATION_SIZE))
    trace, ttc = np.zeros((steps + 1, controlled, TRACE)), np.full(steps + 1, np.inf)
    replay = np.zeros((1, max(len(agents) - controlled, 1), 4)) if replay is None else replay
    made = drive(
        agents, controlled, ego, steps, *drivers, noise, *ego_network[:5], road.reference, road.lanes,
        road.spacing_m, BEAM_TABLE, observations, trace, ttc, replay, stop_with_ego,
    )  # fmt: skip
    return observations[:made], trace[: made + 1], ttc[: made + 1]
