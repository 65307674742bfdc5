"""The rules of the world without SUMO: who is taken over, who leaves, and what the action noise is."""

from __future__ import annotations

import numpy as np
import pytest

from policies import layout
from policies.idm import idm_action
from service.world import agents as A
from service.world.scenario.base import Start
from service.world.sim import step
from service.world.sim.world import DriverNetwork, World, action_noise

DT = 0.1
PINNED = [-0.5141658112314123, 1.0309111217613403, -1.010471272503732, -1.8647755350163375]


def start(station: float = 100.0, lane: int = 2, **more: float) -> Start:
    values = {
        "lane_offset_m": 0.0,
        "lane_heading_rad": 0.0,
        "speed_mps": 15.0,
        "length_m": 4.5,
        "width_m": 1.8,
    }
    return Start(station_m=station, lane=lane, **(values | more))


@pytest.fixture
def make_world(road, drivers):
    """make_world(starts, ego): a world with those vehicles, observed once."""

    def make(starts: list[Start], ego: int = 0) -> World:
        network = DriverNetwork.of(drivers)
        world = World(road, network, len(starts), ego, DT)
        world.reset(starts, drivers.mu0)
        return world

    return make


def run(
    world: World, steps: int, action: tuple[float, float] = (0.0, 0.0), action_noise: np.ndarray | None = None
):
    """Drive with a constant ego action; the statuses and times to collision of the steps + 1 states."""
    states = [world.observe()]
    for k in range(steps):
        world.advance(*action, np.zeros((world.vehicles, 2)) if action_noise is None else action_noise[k])
        states.append(world.observe())
    return states


def test_everybody_starts_where_the_scenario_says(make_world):
    starts = [
        start(120.0, 2, lane_offset_m=0.3, lane_heading_rad=0.05, speed_mps=12.0),
        start(80.0, 0, lane_offset_m=-0.2),
    ]
    world = make_world(starts)
    world.observe()
    for agent, wanted in zip(world.agents, starts, strict=True):
        assert agent[A.STATION] + agent[A.ALONG_M] == pytest.approx(wanted.station_m, abs=1e-6)
        assert agent[A.LANE] == wanted.lane
        assert agent[A.LANE_OFFSET_M] == pytest.approx(wanted.lane_offset_m, abs=1e-3)
        assert agent[A.LANE_HEADING_RAD] == pytest.approx(wanted.lane_heading_rad, abs=5e-4)
        assert agent[A.SPEED_MPS] == wanted.speed_mps


def test_an_observation_holds_what_the_layout_says(make_world):
    world = make_world([start(100.0, 2, lane_offset_m=0.2), start(130.0, 2, speed_mps=10.0)])
    status, ttc = world.observe()
    seen, agent = world.observations[0], world.agents[0]
    assert status == step.RUNNING
    assert seen[layout.LANE_OFFSET_M] == agent[A.LANE_OFFSET_M] == pytest.approx(0.2, abs=1e-3)
    assert seen[layout.SPEED_MPS] == 15.0
    assert (seen[layout.LENGTH_M], seen[layout.WIDTH_M]) == (4.5, 1.8)
    assert seen[layout.LEFT_MARKING_M] + seen[layout.RIGHT_MARKING_M] == pytest.approx(3.66, abs=0.05)
    assert seen[layout.LEFT_MARKING_M] == pytest.approx(3.66 / 2 - 0.2, abs=0.03)
    assert list(seen[layout.LANE_TO_THE_LEFT : layout.RANGE_M]) == [1.0, 1.0, 0.0]
    assert seen[layout.RANGE_M] == pytest.approx(30.0 - 2.25, abs=0.1)
    assert seen[layout.RANGE_RATE_MPS] == pytest.approx(-5.0, abs=0.01)
    assert ttc == pytest.approx(27.75 / 5.0, rel=0.01)
    behind = world.observations[1]
    assert behind[layout.RANGE_M + 10] == pytest.approx(27.75, abs=0.1)


def test_an_environment_vehicle_that_hit_another_is_taken_over_and_stays_so(make_world):
    world = make_world([start(30.0, 0), start(100.0, 3), start(103.0, 3, speed_mps=14.0)])
    world.observe()
    assert world.agents[:, A.COLLISION].tolist() == [0.0, 1.0, 1.0]
    assert world.agents[:, A.TAKEN_OVER].tolist() == [0.0, 0.0, 0.0]
    expected = idm_action(world.observations[2], step.TAKEOVER_SPEED_MPS)
    world.advance(0.0, 0.0, np.full((3, 2), 1e3))  # such noise would turn a network's vehicle
    assert world.agents[:, A.TAKEN_OVER].tolist() == [0.0, 1.0, 1.0]
    assert world.agents[2, A.ACCELERATION_MPS2] == pytest.approx(expected[0], rel=1e-9)
    assert world.agents[2, A.TURN_RATE_RADPS] == pytest.approx(expected[1], rel=1e-9)
    run(world, 100)
    assert world.agents[1:, A.COLLISION].tolist() == [0.0, 0.0]
    assert world.agents[:, A.TAKEN_OVER].tolist() == [0.0, 1.0, 1.0]


@pytest.mark.parametrize(("lane", "outward"), [(0, 1.0), (5, -1.0)])
def test_an_environment_vehicle_that_left_the_road_is_taken_over_and_returns_to_its_lane(
    make_world, lane, outward
):
    world = make_world([start(30.0, 2), start(100.0, lane, lane_offset_m=outward * 2.5)])
    world.observe()
    assert world.agents[1, A.OFF_ROAD] == 1.0
    run(world, 200)
    assert world.agents[1, A.TAKEN_OVER] == 1.0
    assert world.agents[1, A.OFF_ROAD] == 0.0
    assert world.agents[1, A.LANE] == lane
    assert abs(world.agents[1, A.LANE_OFFSET_M]) < 0.1


def test_an_environment_vehicle_that_behaves_is_driven_by_its_network(make_world):
    world = make_world([start(30.0, 2), start(100.0, 4, lane_offset_m=0.5)])
    run(world, 200)
    assert world.agents[1, A.TAKEN_OVER] == 0.0
    assert abs(world.agents[1, A.LANE_OFFSET_M]) < 0.1
    assert world.agents[1, A.SPEED_MPS] == pytest.approx(15.0, abs=1e-9)  # its mean acceleration is 0


@pytest.mark.parametrize(
    ("ego", "other"),
    [(start(100.0, 3), start(103.0, 3)), (start(100.0, 0, lane_offset_m=2.5), start(30.0, 3))],
)
def test_the_ego_is_never_taken_over(make_world, ego, other):
    world = make_world([ego, other])
    status, _ = world.observe()
    assert status in (step.COLLIDED, step.OFF_ROAD)
    world.advance(1.25, 0.125, np.zeros((2, 2)))
    assert world.agents[0, A.TAKEN_OVER] == 0.0
    assert world.agents[0, A.ACCELERATION_MPS2] == pytest.approx(1.25, rel=1e-9)
    assert world.agents[0, A.TURN_RATE_RADPS] == 0.125


def test_an_environment_vehicle_past_the_end_leaves_the_world(make_world, road):
    world = make_world([start(1900.0, 2), start(road.length_m - 10.0, 2), start(1900.0, 4)])
    world.observe()
    assert world.observations[0, layout.RANGE_M] < 100.0 or world.agents[1, A.ACTIVE] == 1.0
    states = run(world, 10)
    assert world.agents[:, A.ACTIVE].tolist() == [1.0, 0.0, 1.0]
    assert world.poses[1, 3] == -1.0
    assert states[-1] == (step.RUNNING, np.inf)
    assert (world.observations[0, layout.RANGE_M : layout.RANGE_M + 3] == 100.0).all()
    where = world.agents[1, [A.X_M, A.Y_M]].copy()
    run(world, 2)
    assert np.array_equal(world.agents[1, [A.X_M, A.Y_M]], where)


def test_the_ego_has_finished_when_its_front_reaches_the_end(make_world, road):
    world = make_world([start(road.length_m - 10.0, 2), start(500.0, 2)])
    states = run(world, 6)
    fronts = road.length_m - 10.0 + 2.25 + 1.5 * np.arange(7)
    assert [status for status, _ in states] == [
        step.FINISHED if front >= road.length_m else step.RUNNING for front in fronts
    ]


def test_an_ego_that_reverses_ends_the_rollout_but_a_stop_does_not(make_world):
    world = make_world([start(speed_mps=1.0), start(500.0, 2)])
    states = run(world, 3, (-4.0, 0.0))
    assert [status for status, _ in states] == [step.RUNNING] * 3 + [step.REVERSED]  # 1.0, 0.6, 0.2, -0.2 m/s
    world.reset([start(speed_mps=0.05), start(500.0, 2)], np.zeros(layout.HEAD_SIZE))
    assert run(world, 1, (-1.0, 0.0))[-1][0] == step.RUNNING  # -0.05 m/s


def test_a_collision_of_the_ego_outweighs_leaving_the_road(make_world):
    world = make_world([start(100.0, 0, lane_offset_m=2.5), start(101.0, 0, lane_offset_m=2.0)])
    assert world.observe()[0] == step.COLLIDED


def test_a_reset_leaves_nothing_of_the_rollout_before(make_world, drivers):
    starts = [start(100.0, 3), start(120.0, 3), start(140.0, 1)]
    world = make_world(starts)
    normals = action_noise(1, 50, 3)
    first = run(world, 50, action_noise=normals), world.agents.copy(), world.observations.copy()
    world.reset([start(50.0, 0), start(52.0, 0), start(1990.0, 5)], drivers.mu0 + 1.0)
    run(world, 80, (1.0, 0.2), action_noise=action_noise(2, 80, 3))
    world.reset(starts, drivers.mu0)
    again = run(world, 50, action_noise=normals), world.agents.copy(), world.observations.copy()
    assert first[0] == again[0]
    assert first[1].tobytes() == again[1].tobytes()
    assert first[2].tobytes() == again[2].tobytes()


def test_a_world_without_an_ego_runs_on(make_world):
    world = make_world([start(100.0, 3), start(103.0, 3)], ego=step.NO_EGO)
    states = run(world, 50)
    assert {status for status, _ in states} == {step.RUNNING}
    assert (world.agents[:, A.TAKEN_OVER] == 1.0).all()


def test_background_rows_are_seen_and_hit_like_any_vehicle(road, drivers):
    network = DriverNetwork.of(drivers)
    world = World(road, network, 2, 0, DT, background_rows=3)
    world.reset([start(100.0, 3), start(200.0, 3)], drivers.mu0)
    world.observe()
    other = world.agents[2]
    other[:] = world.agents[0]
    other[[A.X_M, A.Y_M]] += 3.0 * other[[A.COS, A.SIN]]
    world.count = 3
    status, _ = world.observe()
    assert status == step.COLLIDED
    world.count = 2
    assert world.observe()[0] == step.RUNNING


def test_the_noise_of_a_shorter_rollout_is_a_prefix_of_a_longer_one_s():
    long = action_noise(5, 100, 6)
    assert long.shape == (100, 6, 2)
    assert np.array_equal(action_noise(5, 30, 6), long[:30])


def test_the_noise_of_a_seed_is_pinned():
    """A changed stream would silently change every estimate that was ever stored."""
    first = action_noise(1, 2, 2).ravel()
    assert first[:4].tolist() == PINNED
    assert not np.array_equal(first, action_noise(2, 2, 2).ravel())


def test_a_seed_of_64_bits_is_used_whole():
    assert not np.array_equal(action_noise(7, 1, 3), action_noise(7 + 2**63, 1, 3))
