"""Time to collision by rays: cases worked by hand, and against 3,600 rays."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest

from service.world import agents as A
from service.world.safety.ttc import ego_time_to_collision, time_to_collision
from service.world.sensors.lidar import beam_directions
from service.world.sim.collision import overlap

LENGTH, WIDTH = 4.5, 1.8
EGO = (0.0, 0.0, 0.0, 10.0)  # x, y, heading, speed


def agents_of(*vehicles: tuple[float, float, float, float]) -> np.ndarray:
    agents = np.zeros((len(vehicles), A.COLUMNS))
    agents[:, A.X_M : A.SPEED_MPS + 1] = vehicles
    agents[:, A.LENGTH_M], agents[:, A.WIDTH_M] = LENGTH, WIDTH
    agents[:, A.COS], agents[:, A.SIN] = np.cos(agents[:, A.HEADING_RAD]), np.sin(agents[:, A.HEADING_RAD])
    agents[:, A.ACTIVE] = 1.0
    return agents


def ttc(agents: np.ndarray, rays: int = 20, ego: int = 0) -> float:
    return ego_time_to_collision(
        agents, len(agents), ego, beam_directions(rays), np.full(rays, np.nan), np.full(rays, np.nan)
    )


def test_a_leader_closing_at_5_mps_is_its_rear_bumper_s_distance_from_the_centre_over_5():
    leader = (30.0 + LENGTH / 2, 0.0, 0.0, 5.0)
    assert ttc(agents_of(EGO, leader)) == 6.0


def test_a_leader_that_is_not_slower_is_no_danger():
    assert ttc(agents_of(EGO, (30.0, 0.0, 0.0, 10.0))) == math.inf
    assert ttc(agents_of(EGO, (30.0, 0.0, 0.0, 14.0))) == math.inf


def test_a_faster_follower_counts_from_its_front_bumper():
    follower = (-20.0 - LENGTH / 2, 0.0, 0.0, 14.0)
    assert ttc(agents_of(EGO, follower)) == pytest.approx(5.0, rel=1e-12)


def test_an_oncoming_vehicle_closes_at_the_sum_of_the_speeds():
    assert ttc(agents_of(EGO, (60.0 + LENGTH / 2, 0.0, math.pi, 20.0))) == pytest.approx(2.0, rel=1e-12)


def test_a_vehicle_drifting_in_from_the_left_counts_by_the_beam_that_sees_it_closing():
    """Alongside and parallel, coming 0.5 m/s nearer: beam 5 sees its near side closing at 0.5 m/s.

    Beams 4 and 6 see it farther away and closing more slowly.
    """
    agents = agents_of(EGO, (0.0, 3.0, 0.0, math.hypot(10.0, 0.5)))
    agents[1, A.LENGTH_M] = 2.0
    lean = math.atan2(-0.5, 10.0)
    agents[1, [A.HEADING_RAD, A.COS, A.SIN]] = lean, math.cos(lean), math.sin(lean)
    # its near side leans by the same angle: beam 5 meets it at 3 - (w / 2) / cos(lean)
    expected = (3.0 - 0.5 * WIDTH / math.cos(lean)) / 0.5
    assert ttc(agents) == pytest.approx(expected, rel=1e-9)


def test_a_side_vehicle_going_straight_at_the_same_speed_is_no_danger():
    assert ttc(agents_of(EGO, (0.0, 3.66, 0.0, 10.0))) == math.inf


def test_an_overtaken_side_vehicle_counts_along_the_forward_beams():
    """3.66 m to the left and slower by 5 m/s: beams 1 to 4 hit its near side closing at 5 cos."""
    y = 3.66 - WIDTH / 2
    expected = math.inf
    for beam in (1, 2, 3, 4):
        c, s = math.cos(math.pi * beam / 10), math.sin(math.pi * beam / 10)
        if 2.0 - LENGTH / 2 <= y * c / s <= 2.0 + LENGTH / 2:
            expected = min(expected, (y / s) / (5.0 * c))
    assert ttc(agents_of(EGO, (2.0, 3.66, 0.0, 5.0))) == pytest.approx(expected, rel=1e-12)


def test_of_several_vehicles_the_nearest_in_time_counts():
    far_but_fast, near_but_slow = (82.25, 0.0, 0.0, -30.0), (-32.25, 0.0, 0.0, 12.0)
    assert ttc(agents_of(EGO, far_but_fast)) == pytest.approx(2.0)
    assert ttc(agents_of(EGO, near_but_slow)) == pytest.approx(15.0)
    assert ttc(agents_of(EGO, near_but_slow, far_but_fast)) == pytest.approx(2.0)


def test_at_a_crash_it_stays_positive_because_it_is_measured_to_the_centre():
    touching = (LENGTH, 0.0, 0.0, 4.0)
    agents = agents_of(EGO, touching)
    assert overlap(agents[0], agents[1])
    assert ttc(agents) == pytest.approx(LENGTH / 2 / 6.0, rel=1e-12)


def test_a_centre_inside_another_vehicle_has_time_0():
    assert ttc(agents_of(EGO, (1.0, 0.2, 0.1, 4.0))) == 0.0


def test_there_is_no_limit_of_range():
    assert ttc(agents_of(EGO, (5000.0 + LENGTH / 2, 0.0, 0.0, 0.0))) == 500.0


def test_the_ego_may_be_any_row():
    agents = agents_of((30.0 + LENGTH / 2, 0.0, 0.0, 5.0), EGO)
    assert ttc(agents, ego=1) == 6.0


def test_an_empty_road_is_no_danger():
    assert ttc(agents_of(EGO)) == math.inf


def test_of_ranges_and_rates_only_closing_beams_count():
    ranges, rates = np.array([10.0, 3.0, 8.0, 1.0]), np.array([-2.0, 0.0, -4.0, 5.0])
    assert time_to_collision(ranges, rates) == 2.0
    assert time_to_collision(ranges, np.abs(rates)) == math.inf


def traffic(seed: int) -> np.ndarray:
    """The ego and five others on neighbouring lanes, clear of each other's boxes."""
    g = np.random.default_rng(seed)
    rows = [EGO]
    for lane in (-2, -1, 0, 1, 2):
        x = g.uniform(8.0, 40.0) if lane == 0 else g.uniform(-25.0, 25.0)
        rows.append((x, 3.66 * lane + g.normal() * 0.3, g.normal() * 0.05, g.uniform(0.0, 20.0)))
    return agents_of(*rows)


def dense(agents: np.ndarray, rays: int) -> float:
    """The same definition in vectorised numpy by slabs, with any number of rays."""
    angles = 2.0 * np.pi * np.arange(rays) / rays + agents[0, A.HEADING_RAD]
    ray = np.column_stack([np.cos(angles), np.sin(angles)])
    best_range, best_rate = np.full(rays, np.inf), np.zeros(rays)
    own = agents[0, A.SPEED_MPS] * np.array([agents[0, A.COS], agents[0, A.SIN]])
    for other in agents[1:]:
        c, s = math.cos(other[A.HEADING_RAD]), math.sin(other[A.HEADING_RAD])
        axes = np.array([[c, s], [-s, c]])
        centre = axes @ (other[[A.X_M, A.Y_M]] - agents[0, [A.X_M, A.Y_M]])
        local = ray @ axes.T
        half = np.array([LENGTH, WIDTH]) / 2
        with np.errstate(divide="ignore"):
            a, b = (centre - half) / local, (centre + half) / local
        near, far = np.minimum(a, b).max(axis=1), np.maximum(a, b).min(axis=1)
        hit = (near <= far) & (far >= 0.0) & (np.maximum(near, 0.0) < best_range)
        best_range[hit] = np.maximum(near, 0.0)[hit]
        best_rate[hit] = (ray @ (other[A.SPEED_MPS] * axes[0] - own))[hit]
    with np.errstate(divide="ignore", invalid="ignore"):
        times = np.where(best_rate < 0.0, best_range / -best_rate, np.inf)
    return float(times.min())


@pytest.mark.parametrize("seed", range(40))
def test_twenty_rays_never_see_more_danger_than_3600(seed):
    agents = traffic(seed)
    assert ttc(agents, 20) >= dense(agents, 3600) * (1.0 - 1e-9)


@pytest.mark.parametrize("seed", range(40))
def test_more_rays_come_down_to_the_dense_value(seed):
    agents = traffic(seed)
    # each holds the rays of the one before
    times = [ttc(agents, rays) for rays in (20, 60, 180, 540, 1080, 3240)]
    assert all(a >= b * (1.0 - 1e-9) for a, b in pairwise(times))
    assert times[-1] == pytest.approx(dense(agents, 3240), rel=1e-9)
    assert times[-1] == pytest.approx(dense(agents, 36_000), rel=0.02)
