"""SUMO beside the kernels: the same vehicles in the same places, for many rollouts, alone and in traffic."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from pathlib import Path

import libsumo
import numpy as np
import pytest

import ce
from policies import layout
from policies.egos.idm import IdmEgo
from service.errors import SimulationError
from service.world import agents as A
from service.world.scenario.base import base_distribution
from service.world.sim.rollout import Simulator
from service.world.sim.sumo import SumoSession
from service.world.sim.world import World

NAMES = ["ego", "env1", "env2", "env4", "env5", "env6"]
BACKGROUND = "\n[background]\ndensity_veh_per_km_lane = 12.0\nspeed_mps = 15.0\n"
TWO_SECONDS = {"horizon_s = 10.0": "horizon_s = 2.0"}


@pytest.fixture
def draws(drivers):
    def draw(scenario, n: int):
        x, noise_seeds = ce.draw(base_distribution(scenario, drivers), 11, "estimate", 0, 0, n)
        return list(zip(x, (int(seed) for seed in noise_seeds), strict=True))

    return draw


class Comparison:
    """Compares SUMO's view of the controlled vehicles with the kernels' at every state."""

    def __init__(self, corridor):
        self._corridor = corridor
        self.apart_m: list[float] = []
        self.turned_deg: list[float] = []
        self.wrong_lanes: list[tuple] = []
        self.known: list[set[str]] = []
        self.active: list[set[str]] = []

    def see(self, world: World, time_s: float, ttc_s: float, action) -> None:
        self.known.append({name for name in libsumo.vehicle.getIDList() if not name.startswith("background")})
        self.active.append(
            {name for name, agent in zip(NAMES, world.agents, strict=False) if agent[A.ACTIVE]}
        )
        for name, agent in zip(NAMES, world.agents, strict=False):
            if not agent[A.ACTIVE]:
                continue
            x, y = libsumo.vehicle.getPosition(name)  # of the front bumper
            heading, half = agent[A.HEADING_RAD], 0.5 * agent[A.LENGTH_M]
            front = agent[A.X_M] + half * math.cos(heading), agent[A.Y_M] + half * math.sin(heading)
            self.apart_m.append(math.hypot(x - front[0], y - front[1]))
            turned = libsumo.vehicle.getAngle(name) - (90.0 - math.degrees(heading))
            self.turned_deg.append(abs((turned + 180.0) % 360.0 - 180.0))
            station = agent[A.STATION] + agent[A.ALONG_M]
            lanes = []
            for at in (
                station - 0.5,
                station,
                station + 0.5 * agent[A.LENGTH_M],
                station + agent[A.LENGTH_M],
            ):
                edge, index = self._corridor.sumo_position(int(agent[A.LANE]), at)
                lanes.append((edge, index))
            found = (libsumo.vehicle.getRoadID(name), libsumo.vehicle.getLaneIndex(name))
            if found[0].startswith(":"):  # on the 0.1 m between two edges the lane's index has to do
                found = (lanes[1][0], found[1])
            # SUMO goes by the front bumper, the kernels by the centre: near a marking the two may be in different lanes
            near = 0.05 + half * abs(math.sin(agent[A.LANE_HEADING_RAD]))
            if found not in lanes and min(abs(agent[A.LEFT_MARKING_M]), abs(agent[A.RIGHT_MARKING_M])) > near:
                self.wrong_lanes.append((name, time_s, found, lanes[1]))


def test_six_vehicles_stand_where_the_kernels_say_at_every_step(i80, drivers, make_scenario, draws):
    scenario = make_scenario()
    with Simulator(scenario, i80, drivers, IdmEgo()) as simulator:
        for x, seed in draws(scenario, 3):
            seen = Comparison(i80)
            rollout = simulator.run(x, seed, seen)
            assert len(seen.apart_m) == 6 * (rollout.steps + 1)
            assert max(seen.apart_m) < 0.01
            assert max(seen.turned_deg) < 0.01
            assert seen.wrong_lanes == []
            assert all(known == set(NAMES) for known in seen.known)


def test_vehicles_that_wander_off_the_road_are_placed_exactly_too(i80, drivers, make_scenario, draws):
    class Outwards(IdmEgo):
        def act(self, observation):
            return 0.0, (0.02 if observation.time_s < 2.0 else 0.0)

    scenario = make_scenario(
        {
            'name = "ego"\nrole = "ego"\nlane = 3': 'name = "ego"\nrole = "ego"\nlane = 1',
            'name = "env1"\nlane = 1': 'name = "env1"\nlane = 3',
        }
    )
    with Simulator(scenario, i80, drivers, Outwards()) as simulator:
        seen = Comparison(i80)
        x, seed = draws(scenario, 1)[0]
        assert simulator.run(x, seed, seen).outcome == "off-road"
        assert max(seen.apart_m) < 0.01


def test_the_vehicles_are_put_back_correctly_for_fifty_rollouts(i80, drivers, make_scenario, draws):
    scenario = make_scenario(TWO_SECONDS)
    with Simulator(scenario, i80, drivers, IdmEgo()) as simulator:
        for x, seed in draws(scenario, 50):
            seen = Comparison(i80)
            rollout = simulator.run(x, seed, seen)
            assert rollout.error is None
            assert max(seen.apart_m) < 0.01
            assert all(known == set(NAMES) for known in seen.known)


def test_vehicles_past_the_end_of_the_road_leave_sumo_and_are_back_in_the_next_rollout(
    i80, drivers, make_scenario, draws
):
    scenario = make_scenario({"low = 80.0, high = 120.0": "low = 1930.0, high = 2000.0"})
    gone = 0
    with Simulator(scenario, i80, drivers, IdmEgo()) as simulator:
        for x, seed in draws(scenario, 8):
            seen = Comparison(i80)
            rollout = simulator.run(x, seed, seen)
            assert rollout.error is None
            assert seen.known[0] == set(NAMES)
            # SUMO is told in the step after the one in which the kernels let a vehicle go
            for known, active in zip(seen.known[1:], seen.active[:-1], strict=True):
                assert known <= active
            assert all(active <= known for known, active in zip(seen.known, seen.active, strict=True))
            gone += len(NAMES) - len(seen.active[-1])
    assert gone > 5


def test_a_rollout_leaves_a_floating_car_data_file(i80, drivers, make_scenario, draws, tmp_path):
    scenario = make_scenario(TWO_SECONDS)
    file = tmp_path / "fcd.xml"
    with Simulator(scenario, i80, drivers, IdmEgo(), fcd=file) as simulator:
        x, seed = draws(scenario, 1)[0]
        seen = Comparison(i80)
        steps = simulator.run(x, seed, seen).steps
    moments = ET.parse(file).getroot().findall("timestep")
    assert len(moments) == steps + 1
    for moment in moments:
        assert {vehicle.get("id") for vehicle in moment.findall("vehicle")} == set(NAMES)
    start = {vehicle.get("id"): float(vehicle.get("x")) for vehicle in moments[0]}
    assert len({round(value, 2) for value in start.values()}) == 6


def test_a_second_simulation_in_a_process_is_refused_until_the_first_is_closed(i80):
    with SumoSession(i80, ["a"], [(4.5, 1.8)], 0.1):
        with pytest.raises(SimulationError, match="already runs a SUMO simulation; close it first"):
            SumoSession(i80, ["b"], [(4.5, 1.8)], 0.1)
        assert libsumo.simulation.getTime() == 0.0  # the first is still there
    with SumoSession(i80, ["b"], [(4.5, 1.8)], 0.1):
        pass


def test_closing_twice_does_no_harm(i80):
    session = SumoSession(i80, ["a"], [(4.5, 1.8)], 0.1)
    session.close()
    session.close()
    with SumoSession(i80, ["a"], [(4.5, 1.8)], 0.1) as other:
        session.close()  # not the open one
        assert libsumo.simulation.getTime() == 0.0
        other.close()


def test_a_network_that_sumo_cannot_load_is_a_simulation_error_and_blocks_nothing(i80, tmp_path):
    import dataclasses

    broken = tmp_path / "broken.net.xml"
    broken.write_text("<net", encoding="utf-8")
    with pytest.raises(SimulationError, match=r"SUMO cannot load .*broken\.net\.xml"):
        SumoSession(dataclasses.replace(i80, net_path=str(broken)), ["a"], [(4.5, 1.8)], 0.1)
    with SumoSession(i80, ["a"], [(4.5, 1.8)], 0.1):
        pass


class Traffic:
    """Keeps the background rows of every state, and what the ego's lidar sees."""

    def __init__(self) -> None:
        self.rows: list[np.ndarray] = []
        self.ranges: list[np.ndarray] = []
        self.agents: list[np.ndarray] = []

    def see(self, world: World, time_s: float, ttc_s: float, action) -> None:
        self.rows.append(world.agents[world.vehicles : world.count].copy())
        self.agents.append(world.agents[: world.vehicles].copy())
        self.ranges.append(world.observations[0, layout.RANGE_M : layout.RANGE_RATE_MPS].copy())


@pytest.fixture
def traffic(i80, drivers, make_scenario, draws):
    """traffic(seeds): what was seen of background traffic in a rollout for each of the seeds."""
    scenario = make_scenario(more=BACKGROUND)

    def run(seeds: list[int]) -> list[Traffic]:
        x, _ = draws(scenario, 1)[0]
        found = []
        with Simulator(scenario, i80, drivers, IdmEgo()) as simulator:
            for seed in seeds:
                found.append(Traffic())
                assert simulator.run(x, seed, found[-1]).error is None
        return found

    return run


def test_background_traffic_is_there_in_the_density_asked_for(traffic, i80):
    (seen,) = traffic([1])
    lanes = 5  # the HOV lane stays empty
    wanted = 12.0 * i80.length_m / 1000.0 * lanes
    assert 0.6 * wanted < len(seen.rows[0]) < 1.2 * wanted  # the vehicles' own stretch is kept clear
    assert (seen.rows[0][:, A.ACTIVE] == 1.0).all()
    moved = np.hypot(*(seen.rows[1][:20, [0, 1]] - seen.rows[0][:20, [0, 1]]).T)
    assert 0.5 < np.median(moved) < 2.5


def test_background_vehicles_stand_on_lanes_and_face_along_the_road(traffic, i80):
    (seen,) = traffic([1])
    station, offset = i80.project(seen.rows[0][:, A.X_M], seen.rows[0][:, A.Y_M])
    on_road = (station > 0.0) & (station < i80.length_m)
    assert on_road.mean() > 0.95
    lane = i80.lane_at(station[on_road], offset[on_road])
    assert set(lane) <= {1, 2, 3, 4, 5}
    aside = offset[on_road] - i80.lane_center(lane, station[on_road])
    assert np.abs(aside).max() < 0.5
    heading = i80.to_xy(station[on_road], 0.0)[2]
    turned = (seen.rows[0][on_road, A.HEADING_RAD] - heading + np.pi) % (2.0 * np.pi) - np.pi
    assert np.abs(turned).max() < 0.1


def test_nobody_in_the_background_starts_on_top_of_a_controlled_vehicle(traffic):
    for seen in traffic([1, 2, 3]):
        controlled, others = seen.agents[0], seen.rows[0]
        assert (controlled[:, A.COLLISION] == 0.0).all()
        apart = np.hypot(*(controlled[:, None, :2] - others[None, :, :2]).transpose(2, 0, 1))
        assert apart.min() > 5.0


def test_background_traffic_is_a_function_of_the_seed(traffic):
    first, other, again = traffic([1, 2, 1])
    assert len(first.rows) == len(again.rows)
    for a, b in zip(first.rows, again.rows, strict=True):
        assert a.tobytes() == b.tobytes()
    assert first.rows[0].shape != other.rows[0].shape or not np.array_equal(first.rows[0], other.rows[0])


def test_the_lidar_sees_background_vehicles(traffic):
    runs = traffic([1, 2, 3])
    for ranges, agents, rows in (step for s in runs for step in zip(s.ranges, s.agents, s.rows, strict=True)):
        for beam in np.flatnonzero(ranges < layout.LIDAR_RANGE_M):
            angle = agents[0, A.HEADING_RAD] + 2.0 * math.pi * beam / layout.BEAMS
            hit = agents[0, :2] + ranges[beam] * np.array([math.cos(angle), math.sin(angle)])
            controlled = np.hypot(*(agents[1:, :2] - hit).T).min()
            background = np.hypot(*(rows[:, :2] - hit).T).min()
            if background < 2.6 < controlled:
                return
    pytest.fail("no beam of three rollouts ended at a background vehicle")


def test_more_background_vehicles_than_rows_is_an_error_that_says_what_to_do(i80):
    from service.world.sim.sumo_background import BackgroundTraffic

    traffic = BackgroundTraffic(30.0, 15.0, 80.0, 120.0, 20.0)
    with SumoSession(i80, ["a"], [(4.5, 1.8)], 0.1, background=traffic) as session:
        session.begin(np.array([[*_front(i80, 100.0), 0.0, 100.0 * 7 + 2]]), 1)
        with pytest.raises(SimulationError, match="more than 10 background vehicles; lower the density"):
            session.read_background(np.zeros((11, A.COLUMNS)), 1)


def _front(i80, station: float) -> tuple[float, float]:
    x, y, _ = i80.to_xy(station, 0.0)
    return float(x), float(y)


def test_libsumo_is_imported_in_one_file_only():
    root = Path(__file__).parents[3]
    importers = [
        path.relative_to(root).as_posix()
        for folder in ("service", "policies", "ce", "sumo_nets")
        for path in (root / folder).rglob("*.py")
        if any(
            line.startswith(("import libsumo", "from libsumo"))
            for line in path.read_text(encoding="utf-8").splitlines()
        )
    ]
    assert importers == ["service/world/sim/sumo_library.py"]
