"""An ego among a scenario's drivers: what it sees there, and how often it touches them."""

import numpy as np
import pytest

import ce
from policies import layout as O
from policies.drivers import load_drivers
from policies.egos import Observation, load_ego
from service.training.demonstrations import AGGREGATED
from service.training.lane_changes import KeepingExpert
from service.training.traffic import Traffic, policy_of
from service.training.world import network_of
from service.world.scenario.base import unpack
from service.world.sim import step
from service.world.sim.without_sumo import WithoutSumo


@pytest.fixture(scope="module", params=["i80-paper-10s", "i80-10s"])
def traffic(request) -> Traffic:
    """Among the paper's drivers, and among human ones."""
    return Traffic(request.param)


def test_a_drive_is_the_services_rollout(traffic):
    ego = load_ego("lidar-paper")
    drivers = load_drivers(traffic.scenario.drivers.weights)
    alone = WithoutSumo(traffic.scenario, traffic.corridor, drivers, "lidar-paper")
    x, seeds = traffic.draw(5, 4)
    for row, seed in zip(x, seeds.tolist(), strict=True):
        drive = traffic.drive(lambda seen: ego.act(Observation(seen, 0.0)), row, seed)
        expected = alone.run(row, seed)
        assert drive.status == {"horizon": step.RUNNING, "collision": step.COLLIDED}[expected.outcome]
        assert np.array_equal(traffic.world.agents, alone._world.agents)
        assert 0.05 < drive.km < 0.3


def test_a_harder_start_puts_a_vehicle_on_its_way_into_the_lane(traffic):
    rng = np.random.default_rng(1)
    x = ce.draw(traffic.base, 1, "estimate", 0, 0, 20)[0]
    for row in x:
        starts, _ = unpack(traffic.scenario, traffic.harder(row, rng))
        before, _ = unpack(traffic.scenario, row)
        (other,) = (i for i, (a, b) in enumerate(zip(starts, before, strict=True)) if a != b)
        me, you = starts[traffic.world.ego], starts[other]
        assert -10.0 <= you.station_m - me.station_m <= 35.0
        assert -9.0 <= you.speed_mps - me.speed_mps <= 3.0
        towards = np.sign(
            you.lane - me.lane
        )  # lanes are numbered from the left, offsets are positive to the left
        assert abs(you.lane - me.lane) == 1
        assert towards * (you.lane_offset_m - before[other].lane_offset_m) >= 0.0
        assert towards * you.lane_heading_rad >= 0.0


def test_moments_are_labelled_by_the_demonstrator(traffic):
    rows = traffic.visited(
        network_of(load_drivers("ego-lidar-paper")), KeepingExpert(), 6, np.random.default_rng(2)
    )
    assert set(rows.kind) == {AGGREGATED}
    assert np.unique(rows.trajectory).size == 6
    assert not rows.seen[:, O.INCIDENT].any()
    assert np.isfinite(rows.action).all()
    assert len(rows.action) == len(rows.seen) > 6 * 20


def test_contacts_are_counted_with_their_interval(traffic):
    """An ego that turns right at full lock leaves its lane at once."""
    found = traffic.contacts(lambda seen: (0.0, -0.1), 6, seed=3)
    assert found["contacts"]["count"] + found["left_the_road"] == 6
    assert found["brought_about_by_the_ego"] <= found["contacts"]["count"]
    low, high = found["contacts"]["interval_95"]
    assert low <= found["contacts"]["per_million_km"] <= high


def test_policy_of_a_network_is_the_lidar_ego(traffic):
    ego, policy = load_ego("lidar-paper"), policy_of(network_of(load_drivers("ego-lidar-paper")))
    seen = np.abs(np.random.default_rng(4).normal(size=(5, O.OBSERVATION_SIZE))) * 5.0
    for row in seen:
        assert policy(row) == pytest.approx(ego.act(Observation(row, 0.0)), rel=1e-6)
