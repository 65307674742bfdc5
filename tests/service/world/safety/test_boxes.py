"""Box-to-box time to collision and separation: by hand, and against moving the boxes and intersecting the polygons."""

from __future__ import annotations

import math

import cv2
import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from service.world import agents as A
from service.world.safety.boxes import box_time_to_collision, clearance, separation, time_until_touch

EGO = (0.0, 0.0, 0.0, 10.0)
LENGTH, WIDTH = 4.5, 1.8


def test_a_leader_is_its_bumper_gap_over_the_difference_of_speeds(agents_of):
    assert box_time_to_collision(agents_of(EGO, (24.5, 0.0, 0.0, 5.0)), 2, 0) == pytest.approx(4.0)


def test_a_faster_follower_counts_as_much_as_a_slower_leader(agents_of):
    assert box_time_to_collision(agents_of(EGO, (-24.5, 0.0, 0.0, 15.0)), 2, 0) == pytest.approx(4.0)


def test_a_vehicle_in_the_next_lane_is_no_danger_until_it_comes_over(agents_of):
    beside = (0.0, 3.6, 0.0, 10.0)
    assert box_time_to_collision(agents_of(EGO, beside), 2, 0) == math.inf
    assert clearance(agents_of(EGO, beside), 2, 0) == pytest.approx(1.8)
    angle = -0.1
    speed = 10.0 / math.cos(angle)  # as fast along the road, and towards the ego across it
    gap = 3.6 - 0.5 * WIDTH - 0.5 * (LENGTH * math.sin(0.1) + WIDTH * math.cos(0.1))
    coming = agents_of(EGO, (0.0, 3.6, angle, speed))
    assert box_time_to_collision(coming, 2, 0) == pytest.approx(gap / (speed * math.sin(0.1)))


def test_a_crossing_vehicle_that_passes_behind_is_no_danger(agents_of):
    assert box_time_to_collision(agents_of(EGO, (30.0, -25.0, math.pi / 2, 10.0)), 2, 0) == pytest.approx(
        2.685
    )
    assert box_time_to_collision(agents_of(EGO, (30.0, -60.0, math.pi / 2, 10.0)), 2, 0) == math.inf


def test_boxes_that_touch_already_have_no_time_left(agents_of):
    touching = agents_of(EGO, (4.0, 0.5, 0.2, 3.0))
    assert box_time_to_collision(touching, 2, 0) == 0.0
    assert clearance(touching, 2, 0) < 0.0


def test_vehicles_that_left_the_road_do_not_count(agents_of):
    agents = agents_of(EGO, (24.5, 0.0, 0.0, 5.0))
    agents[1, A.ACTIVE] = 0.0
    assert box_time_to_collision(agents, 2, 0) == clearance(agents, 2, 0) == math.inf


def test_an_ego_alone_is_safe(agents_of):
    assert box_time_to_collision(agents_of(EGO), 1, 0) == math.inf


metres, angles, speeds = st.floats(-30.0, 30.0), st.floats(-math.pi, math.pi), st.floats(-5.0, 30.0)
cars = st.tuples(metres, metres, angles, speeds, st.floats(1.0, 12.0), st.floats(0.5, 3.0))


def intersect(a: tuple[float, ...], b: tuple[float, ...]) -> bool:
    """Whether the boxes (x, y, heading, speed, length, width) intersect, by OpenCV."""
    found, _ = cv2.rotatedRectangleIntersection(
        *[((x, y), (l, w), math.degrees(h)) for x, y, h, _, l, w in (a, b)]
    )
    return found != cv2.INTERSECT_NONE


@settings(max_examples=150, deadline=None)
@given(cars, cars)
@example((0.0, 0.0, 0.0, 10.0, 4.5, 1.8), (20.0, 0.0, math.pi, 10.0, 4.5, 1.8))
def test_the_time_until_touch_is_when_the_moved_polygons_first_meet(agents_of, a, b):
    agents = agents_of(a, b)
    found = time_until_touch(agents[0], agents[1])

    def meet(t: float) -> bool:
        return intersect(
            *[(x + v * t * math.cos(h), y + v * t * math.sin(h), h, v, *size) for x, y, h, v, *size in (a, b)]
        )

    for t in np.linspace(0.0, min(found, 6.0), 25, endpoint=False):
        if t < found - 1e-3:
            assert not meet(t), f"they meet at {t} already"
    deep = [t for t in np.linspace(found, found + 2.0, 60) if found < math.inf]
    vx = b[3] * math.cos(b[2]) - a[3] * math.cos(a[2])
    vy = b[3] * math.sin(b[2]) - a[3] * math.sin(a[2])
    if deep and math.hypot(vx, vy) > 1.0:
        stays = separation_after(agents_of, a, b, found + 0.05)
        assert stays < 0.05 or any(meet(t) for t in deep)


def separation_after(agents_of, a, b, t: float) -> float:
    moved = agents_of(
        *[
            (x + v * t * math.cos(h), y + v * t * math.sin(h), h, v, length, width)
            for x, y, h, v, length, width in (a, b)
        ]
    )
    return clearance(moved, 2, 0)


@settings(max_examples=150, deadline=None)
@given(cars, cars)
def test_separation_is_below_zero_exactly_where_the_polygons_intersect(agents_of, a, b):
    one, two = agents_of(a, b)
    gap = separation(*[v[c] for v in (one, two) for c in (A.X_M, A.Y_M, A.COS, A.SIN, A.LENGTH_M, A.WIDTH_M)])
    if abs(gap) > 0.05:
        assert (gap < 0.0) == intersect(a, b)
