"""RSS margins: cases worked by hand, and against vehicles that are driven through the worst case step by step."""

from __future__ import annotations

import math

import numpy as np
import pytest

from service.world import agents as A
from service.world.safety.rss import (
    ACROSS,
    ALONG,
    BOTH,
    rss_margin,
    rss_parameters,
    safe_distance_across,
    safe_distance_along,
)

EGO = (0.0, 0.0, 0.0, 20.0)


@pytest.fixture
def rss(make_scenario) -> np.ndarray:
    """Response 1 s, 3.5, 4 and 8 m/s^2 along the road, 0.2 and 0.8 m/s^2 and 0.1 m across it."""
    return rss_parameters(make_scenario())


def test_the_safe_distance_along_is_that_of_the_paper_s_formula(rss):
    # 20 m/s behind 20 m/s: 20 + 1.75 + 23.5^2 / 8 - 400 / 16 = 20 + 1.75 + 69.03125 - 25
    assert safe_distance_along(20.0, 20.0, rss) == pytest.approx(65.78125)
    assert safe_distance_along(5.0, 40.0, rss) == 0.0
    assert (
        safe_distance_along(-3.0, -3.0, rss)
        == safe_distance_along(0.0, 0.0, rss)
        == pytest.approx(1.75 + 12.25 / 8)
    )


@pytest.mark.parametrize(("rear", "front"), [(20.0, 20.0), (30.0, 10.0), (8.0, 0.0), (15.0, 16.0)])
def test_a_gap_of_the_safe_distance_closes_exactly_in_the_worst_case(rss, rear, front):
    """Both are driven in steps of 0.1 ms: the front one brakes at 8, the rear one speeds up for 1 s and brakes at 4."""
    dt, gap, v, w, t = 1e-4, safe_distance_along(rear, front, rss), rear, front, 0.0
    smallest = gap
    while v > 0.0 or w > 0.0:
        new_w = max(w - 8.0 * dt, 0.0)
        new_v = v + 3.5 * dt if t < 1.0 - dt / 2 else max(v - 4.0 * dt, 0.0)
        gap += 0.5 * (w + new_w - v - new_v) * dt
        v, w, t = new_v, new_w, t + dt
        smallest = min(smallest, gap)
    assert smallest == pytest.approx(0.0, abs=0.02)


def test_the_safe_distance_across_is_that_of_the_paper_s_formula(rss):
    # each at rest: 0.2 / 2 + 0.04 / 1.6 = 0.125 m; 0.5 m/s towards the other: 0.6 + 0.49 / 1.6 = 0.90625 m
    assert safe_distance_across(0.0, 0.0, rss) == pytest.approx(0.1 + 0.25)
    assert safe_distance_across(0.5, 0.0, rss) == pytest.approx(0.1 + 0.90625 + 0.125)
    assert safe_distance_across(-1.0, -1.0, rss) == 0.1  # both move away


@pytest.mark.parametrize("speeds", [(0.0, 0.0), (0.5, 0.2), (1.0, -0.5)])
def test_a_gap_across_of_the_safe_distance_leaves_the_margin_in_the_worst_case(rss, speeds):
    dt = 1e-4
    gap = safe_distance_across(*speeds, rss)
    for speed in speeds:
        v, t = speed, 0.0
        while t < 1.0 - dt / 2:
            gap -= (v + 0.1 * dt) * dt
            v, t = v + 0.2 * dt, t + dt
        brake = -0.8 if v > 0.0 else 0.8
        while v * brake < 0.0:
            gap -= v * dt
            v += brake * dt
    assert gap == pytest.approx(0.1, abs=2e-3)


def test_a_follower_s_margin_is_its_gap_less_the_safe_distance(agents_of, rss):
    agents = agents_of(EGO, (60.0, 0.0, 0.0, 20.0))
    assert rss_margin(agents, 2, 0, rss, ALONG) == pytest.approx(60.0 - 4.5 - 65.78125)
    # seen from the other one too
    assert rss_margin(agents, 2, 1, rss, ALONG) == rss_margin(agents, 2, 0, rss, ALONG)


def test_a_vehicle_beside_the_ego_is_safe_by_the_margin_across(agents_of, rss):
    agents = agents_of(EGO, (1.0, 3.6, 0.0, 25.0))
    assert rss_margin(agents, 2, 0, rss, ACROSS) == pytest.approx(1.8 - 0.35)
    assert rss_margin(agents, 2, 0, rss, BOTH) == pytest.approx(1.8 - 0.35)
    assert rss_margin(agents, 2, 0, rss, ALONG) == math.inf


def test_one_that_drifts_towards_the_ego_is_dangerous_on_either_side(agents_of, rss):
    angle = 0.05
    for side in (1.0, -1.0):
        agents = agents_of(EGO, (0.0, side * 2.6, -side * angle, 20.0))
        gap = 2.6 - 0.9 - 0.5 * (4.5 * math.sin(angle) + 1.8 * math.cos(angle))
        need = safe_distance_across(0.0, 20.0 * math.sin(angle), rss)
        assert rss_margin(agents, 2, 0, rss, BOTH) == pytest.approx(gap - need)
        assert gap - need < 0.0


def test_a_situation_is_dangerous_only_if_both_distances_are_unsafe(agents_of, rss):
    ahead = agents_of(EGO, (60.0, 3.6, 0.0, 20.0))  # too close along the road, safe across it
    assert rss_margin(ahead, 2, 0, rss, BOTH) == pytest.approx(1.8 - 0.35)
    assert rss_margin(agents_of(EGO, (80.0, 0.0, 0.0, 20.0)), 2, 0, rss, BOTH) == pytest.approx(
        75.5 - 65.78125
    )


def test_in_a_bend_a_leader_in_the_own_lane_is_in_the_own_lane(agents_of, rss):
    """On a circle of 200 m radius, a leader 50 m ahead stands 6.2 m to the left of where the ego points."""
    along, radius = 50.0, 200.0
    angle = along / radius
    agents = agents_of(EGO, (radius * math.sin(angle), radius * (1 - math.cos(angle)), angle, 20.0))
    agents[:, A.LANE_HEADING_RAD] = 0.0
    agents[:, A.CURVATURE_PER_M] = 1.0 / radius
    straight = rss_margin(agents_of(EGO, (along, 0.0, 0.0, 20.0)), 2, 0, rss, ALONG)
    assert rss_margin(agents, 2, 0, rss, ALONG) == pytest.approx(straight, abs=0.6)
    agents[:, A.CURVATURE_PER_M] = 0.0
    assert rss_margin(agents, 2, 0, rss, ALONG) == math.inf
