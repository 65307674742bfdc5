"""Flow, speed and density of a stream of modelled drivers in SUMO, at I-80's demand, beside the recorded ones.

Vehicles enter the first part of the I-80 network as many as drove through the recorded stretch (flow of the space-time
fields, lanes as Coifman and Li counted them), and beyond BOUNDARY_M nobody drives faster than was recorded
downstream at that moment in that lane: the jam that the recorded stretch stood in came from there. What happens
between is the drivers' own. SUMO counts: its edges' vehicle numbers and mean speeds, the same for every model.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl

from policies import layout
from policies.baselines.idm_mobil import PARAMETERS
from policies.data.ngsim_schema import METRES_PER_FOOT
from policies.jit import kernel
from policies.network import forward, sample_action
from policies.realism.statistics import rounded
from service.studies.realism.drive import BEAMS, HUMAN, NETWORK, NOBODY, Model, idm_mobil_step
from service.studies.realism.people import UNNEEDED, advance_people, people
from service.studies.realism.sumo_traffic import SumoTraffic
from service.world import agents as A
from service.world.sim.dynamics import advance
from service.world.sim.latent import CHANNELS
from service.world.sim.projection import place
from service.world.sim.road import Road, road_of
from service.world.sim.step import NO_EGO, observe
from sumo_nets.corridor import Corridor

FIELDS = "macroscopic/avila_i80_fields_4pm_5pm.parquet"
LANES_FILE = "trajectories/coifman_li_2017_i80_cam6_0400-0415.parquet"
BIN_S = 5.0
MAIN_LANES = 6
ENTRY_M, ZONE_M, BOUNDARY_M, EXIT_M = 60.0, (250.0, 650.0), 700.0, 820.0
WARM_UP_S, MEASURED_S = 180.0, 240.0
START_S = 60.0  # of the recorded period
AVERAGE_S = 30.0
ENTRY_GAP_S, ENTRY_GAP_M = 0.8, 3.0
LENGTH_M, WIDTH_M = 4.5, 1.8
CAPACITY = 500
STRETCH_BINS = slice(20, 61)  # of the fields: the middle half; fields are thin at their ends


@dataclass(frozen=True)
class Demand:
    """flow (bins, lanes) veh/s into the stretch and boundary (bins, lanes) m/s at its end, from START_S on; recorded
    (bins, 3): flow veh/s, speed m/s, density veh/m over all lanes within the stretch, while measured."""

    flow: np.ndarray
    boundary: np.ndarray
    recorded: np.ndarray


def demand(data: Path) -> Demand | None:
    """The recorded demand of 16:00 to 16:15, or None where the data do not have it."""
    if not (data / FIELDS).is_file() or not (data / LANES_FILE).is_file():
        return None
    fields = pl.read_parquet(data / FIELDS).filter(pl.col("period") == "4pm").sort("t_bin", "x_bin")
    times, places = fields["t_bin"].n_unique(), fields["x_bin"].n_unique()
    flow, speed, density = (
        fields[name].to_numpy().reshape(times, places) for name in ("flow", "velocity", "density")
    )
    first, count = round(START_S / BIN_S), round((WARM_UP_S + MEASURED_S) / BIN_S)
    rows = slice(first, first + count)
    lanes = pl.read_parquet(data / LANES_FILE).filter(pl.col("lane_id") <= MAIN_LANES)
    share = np.array(
        [lanes.filter(pl.col("lane_id") == k + 1)["vehicle_id"].n_unique() for k in range(MAIN_LANES)]
    )
    boundary = np.empty((count, MAIN_LANES))
    at = np.arange(first, first + count)
    for k in range(MAIN_LANES):
        mean = (
            lanes.filter(pl.col("lane_id") == k + 1)
            .group_by((pl.col("frame_id") // round(BIN_S * 10)).alias("bin"))
            .agg(pl.col("v_vel_ftps").mean() * METRES_PER_FOOT)
            .sort("bin")
        )
        boundary[:, k] = np.interp(at, mean["bin"].to_numpy(), mean["v_vel_ftps"].to_numpy())
    entering = flow[rows, STRETCH_BINS].mean(axis=1)[:, None] * share / share.sum()
    warm = round(WARM_UP_S / BIN_S)
    inside = np.column_stack(
        [
            flow[rows, STRETCH_BINS].mean(axis=1),
            speed[rows, STRETCH_BINS].mean(axis=1) * METRES_PER_FOOT,
            density[rows, STRETCH_BINS].mean(axis=1) / METRES_PER_FOOT,
        ]
    )
    return Demand(entering, boundary, inside[warm:])


@kernel
def stream_step(
    kind: int, agents: np.ndarray, w1: np.ndarray, b1: np.ndarray, w2: np.ndarray, b2: np.ndarray, head: np.ndarray,
    action_scale: np.ndarray, p: np.ndarray, action_noise: np.ndarray, chance: np.ndarray, reference: np.ndarray,
    lanes: np.ndarray, spacing_m: float, beams: np.ndarray, boundary: np.ndarray, boundary_m: float, exit_m: float,
    wanted: np.ndarray, seen: np.ndarray, happens: np.ndarray, minds: np.ndarray, traits: np.ndarray,
    poses: np.ndarray,
) -> tuple[int, int]:  # fmt: skip
    """One step of 0.1 s of all active rows of `agents`; returns how many are in contact and how many there are."""
    count = agents.shape[0]
    outputs = np.empty(layout.OUTPUTS, np.float32)
    observe(agents, count, count, NO_EGO, reference, lanes, spacing_m, beams, beams, seen)
    station, speed, length = np.zeros(count), np.zeros(count), agents[:, A.LENGTH_M].copy()
    lane, present = np.zeros(count, np.int64), np.zeros(count, np.bool_)
    contacts, there = 0, 0
    for i in range(count):
        agent = agents[i]
        present[i] = agent[A.ACTIVE] != 0.0
        speed[i], lane[i] = agent[A.SPEED_MPS], int(agent[A.LANE])
        station[i] = agent[A.STATION] * spacing_m + agent[A.ALONG_M]
        if present[i]:
            there += 1
            contacts += 1 if agent[A.COLLISION] != 0.0 else 0
    if kind == HUMAN:
        advance_people(
            agents, count, count, seen, w1, b1, w2, b2, head, action_scale, happens, reference, lanes, spacing_m, minds,
            traits, poses,
        )  # fmt: skip
        for i in range(count):
            agent = agents[i]
            if station[i] > boundary_m:
                limit = boundary[min(lane[i], boundary.shape[0] - 1)]
                most = max((limit - speed[i]) / 2.0, -3.0)
                if agent[A.ACCELERATION_MPS2] > most:
                    agent[A.SPEED_MPS] = max(
                        agent[A.SPEED_MPS] - 0.1 * (agent[A.ACCELERATION_MPS2] - most), 0.0
                    )
                    agent[A.ACCELERATION_MPS2] = most
            if present[i] and station[i] > exit_m:
                agent[A.ACTIVE] = 0.0
        return contacts, there
    for i in range(count):
        agent = agents[i]
        if not present[i]:
            continue
        if kind == NETWORK:
            forward(seen[i], w1, b1, w2, b2, head, outputs)
            a, w = sample_action(outputs, action_scale, action_noise[i, 0], action_noise[i, 1])
        else:
            a, w = idm_mobil_step(
                p, agent, i, station, lane, speed, length, present, MAIN_LANES - 1, wanted, chance[i], lanes,
            )  # fmt: skip
        if station[i] > boundary_m:
            limit = boundary[min(lane[i], boundary.shape[0] - 1)]
            a = min(a, max((limit - speed[i]) / 2.0, -3.0))
        advance(agent, a, w, 0.1, False)
        if station[i] > exit_m:
            agent[A.ACTIVE] = 0.0
    return contacts, there


class Counter:
    """SUMO's counts on the zone's edges, averaged over AVERAGE_S."""

    def __init__(self, traffic: SumoTraffic):
        self._traffic = traffic
        self._edges = traffic.between(*ZONE_M)
        self._length = traffic.length_of(self._edges)
        self._rows: list[tuple[float, float]] = []

    def observe(self) -> None:
        self._rows.append(self._traffic.count(self._edges))

    def averages(self) -> np.ndarray:
        """(intervals, 3): flow veh/s, speed m/s, density veh/m."""
        size = round(AVERAGE_S / 0.1)
        rows = np.array(self._rows[: len(self._rows) // size * size]).reshape(-1, size, 2).mean(axis=1)
        number, total = rows.T
        return np.column_stack(
            [total / self._length, total / np.maximum(number, 1e-9), number / self._length]
        )


def of_model(
    model: Model, corridor: Corridor, wanted_flow: Demand, head: np.ndarray | None, seed: int
) -> dict[str, Any]:
    """The stream of a model that runs in our kernels; SUMO holds the same vehicles and counts them."""
    rng = np.random.default_rng(seed)
    road = road_of(corridor)
    agents = np.zeros((CAPACITY, A.COLUMNS))
    agents[:, A.LENGTH_M], agents[:, A.WIDTH_M] = LENGTH_M, WIDTH_M
    wanted = np.full(CAPACITY, -1, np.int64)
    seen = np.zeros((CAPACITY, layout.OBSERVATION_SIZE))
    names: list[str | None] = [None] * CAPACITY
    drivers = model.drivers if model.drivers is not None else NOBODY
    weights = (drivers.mu0 if head is None else head).astype(np.float32)
    p = model.values if model.values is not None else np.zeros(len(PARAMETERS))
    waiting = np.zeros(MAIN_LANES)
    entered = contacts = frames = 0
    steps = round((WARM_UP_S + MEASURED_S) / 0.1)
    happens, minds, traits, poses = UNNEEDED[0], UNNEEDED[1], UNNEEDED[2], np.zeros((CAPACITY, 4))
    if model.human is not None:
        happens, minds, traits = people(model.human, steps, CAPACITY, rng, staying=False)
    fresh = minds.copy()
    nothing = np.zeros((0, CHANNELS))
    with SumoTraffic(corridor, 0.1, seed) as traffic:
        counter = Counter(traffic)
        for t in range(steps):
            now = min(int(t * 0.1 / BIN_S), len(wanted_flow.flow) - 1)
            waiting += rng.poisson(wanted_flow.flow[now] * 0.1)
            for lane in np.flatnonzero(waiting > 0):
                slot = _enter(agents, int(lane), wanted_flow.boundary[now, lane], road)
                if slot >= 0:
                    waiting[lane] -= 1
                    wanted[slot] = -1
                    minds[slot : slot + 1] = fresh[slot : slot + 1]
                    entered += 1
                    names[slot] = f"v{entered}"
                    traffic.add(
                        f"v{entered}", LENGTH_M, WIDTH_M, int(lane), ENTRY_M, agents[slot, A.SPEED_MPS], True
                    )
            touching, there = stream_step(
                model.kind, agents, drivers.w1, drivers.b1, drivers.w2, drivers.b2, weights, drivers.action_scale, p,
                rng.standard_normal((CAPACITY, 2)), rng.random((CAPACITY, 2)), road.reference, road.lanes,
                road.spacing_m, BEAMS, wanted_flow.boundary[now], BOUNDARY_M, EXIT_M, wanted, seen,
                happens[t] if model.human is not None else nothing, minds, traits, poses,
            )  # fmt: skip
            _mirror(traffic, agents, names, road.spacing_m)
            traffic.step()
            if t * 0.1 >= WARM_UP_S:
                counter.observe()
                contacts, frames = contacts + touching, frames + there
    return _facts(counter.averages(), wanted_flow, waiting) | {
        "touching_share": rounded(contacts / max(frames, 1), 5)
    }


def _enter(agents: np.ndarray, lane: int, speed: float, road: Road) -> int:
    """Put a vehicle into the first free row where its lane has room; the row, or -1."""
    active = agents[:, A.ACTIVE] > 0
    along = agents[:, A.STATION] * road.spacing_m + agents[:, A.ALONG_M]
    ahead = active & (agents[:, A.LANE] == lane) & (along > ENTRY_M - LENGTH_M)
    if ahead.any():
        first = np.flatnonzero(ahead)[along[ahead].argmin()]
        speed = min(speed, float(agents[first, A.SPEED_MPS]) + 1.0)
        if along[first] - ENTRY_M - LENGTH_M < ENTRY_GAP_M + ENTRY_GAP_S * speed:
            return -1
    free = np.flatnonzero(~active)
    if not len(free):
        return -1
    agent = agents[free[0]]
    agent[:] = 0.0
    agent[A.LENGTH_M], agent[A.WIDTH_M], agent[A.SPEED_MPS], agent[A.ACTIVE] = LENGTH_M, WIDTH_M, speed, 1.0
    place(agent, ENTRY_M, lane, 0.0, 0.0, road.reference, road.lanes, road.spacing_m)
    agent[A.LANE] = lane
    return int(free[0])


def _mirror(traffic: SumoTraffic, agents: np.ndarray, names: list[str | None], spacing_m: float) -> None:
    on_road = traffic.names()
    rows = agents[:, [A.ACTIVE, A.LANE, A.STATION, A.ALONG_M, A.SPEED_MPS]].tolist()
    for i, name in enumerate(names):
        if name is None:
            continue
        active, lane, station, along, speed = rows[i]
        if active == 0.0:
            traffic.remove(name)
            names[i] = None
        elif name in on_road:
            traffic.put(name, int(lane), station * spacing_m + along, speed)


def of_sumo(corridor: Corridor, wanted_flow: Demand, seed: int) -> dict[str, Any]:
    """The stream of SUMO's own drivers."""
    rng = np.random.default_rng(seed)
    entered = 0
    with SumoTraffic(corridor, 0.1, seed, insert_anyhow=False) as traffic:
        counter = Counter(traffic)
        downstream = traffic.between(BOUNDARY_M, EXIT_M)
        beyond = traffic.between(EXIT_M, corridor.length_m)
        limits = [25.0] * MAIN_LANES
        for t in range(round((WARM_UP_S + MEASURED_S) / 0.1)):
            now = min(int(t * 0.1 / BIN_S), len(wanted_flow.flow) - 1)
            if t % round(BIN_S / 0.1) == 0:
                for lane in range(MAIN_LANES):
                    limits[lane] = float(wanted_flow.boundary[now, lane])
                    traffic.limit(downstream, lane, limits[lane])
                    traffic.limit(beyond, lane, 30.0)
            for lane, vehicles in enumerate(rng.poisson(wanted_flow.flow[now] * 0.1)):
                for _ in range(vehicles):
                    entered += 1
                    traffic.add(f"v{entered}", LENGTH_M, WIDTH_M, lane, ENTRY_M, limits[lane], False)
            traffic.step()
            if t * 0.1 >= WARM_UP_S:
                counter.observe()
        waiting = entered - traffic.seen
    return _facts(counter.averages(), wanted_flow, np.array([waiting]))


def _facts(averages: np.ndarray, wanted_flow: Demand, waiting: np.ndarray) -> dict[str, Any]:
    flow, speed, density = averages.mean(axis=0)
    return {
        "flow_veh_per_h": rounded(3600.0 * flow, 0),
        "speed_mps": rounded(speed),
        "density_veh_per_km": rounded(1000.0 * density, 1),
        "sd_of_30_s": [
            rounded(3600.0 * averages[:, 0].std(), 0),
            rounded(averages[:, 1].std()),
            rounded(1000.0 * averages[:, 2].std(), 1),
        ],
        "waiting_to_enter": int(waiting.sum()),
    }


def recorded_facts(wanted_flow: Demand) -> dict[str, Any]:
    """The recorded stretch in the same figures."""
    size = round(AVERAGE_S / BIN_S)
    rows = wanted_flow.recorded
    averages = rows[: len(rows) // size * size].reshape(-1, size, 3).mean(axis=1)
    facts = _facts(averages, wanted_flow, np.zeros(1))
    del facts["waiting_to_enter"]
    return facts
