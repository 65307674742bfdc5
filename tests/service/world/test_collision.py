"""Overlap of vehicles' boxes: cases by hand, and against clipping one polygon by the other."""

from __future__ import annotations

import math

import numpy as np
import pytest

from service.world import agents as A
from service.world.sim.collision import mark_collisions, overlap


def box(x: float, y: float, heading: float = 0.0, length: float = 4.0, width: float = 2.0) -> np.ndarray:
    agent = np.zeros(A.COLUMNS)
    agent[[A.X_M, A.Y_M, A.HEADING_RAD, A.LENGTH_M, A.WIDTH_M]] = x, y, heading, length, width
    agent[[A.COS, A.SIN, A.ACTIVE]] = math.cos(heading), math.sin(heading), 1.0
    return agent


def polygon(agent: np.ndarray) -> np.ndarray:
    along, left = np.array([agent[A.COS], agent[A.SIN]]), np.array([-agent[A.SIN], agent[A.COS]])
    centre = agent[[A.X_M, A.Y_M]]
    half = 0.5 * agent[A.LENGTH_M] * along, 0.5 * agent[A.WIDTH_M] * left
    return np.array([centre + a * half[0] + b * half[1] for a, b in ((1, 1), (-1, 1), (-1, -1), (1, -1))])


def shared_area(a: np.ndarray, b: np.ndarray) -> float:
    """Area of the intersection by Sutherland and Hodgman's clipping (both polygons counter-clockwise)."""
    subject = list(polygon(a))
    clip = polygon(b)
    for p, q in zip(clip, np.roll(clip, -1, axis=0), strict=True):

        def side(point: np.ndarray, p: np.ndarray = p, q: np.ndarray = q) -> float:
            return (q[0] - p[0]) * (point[1] - p[1]) - (q[1] - p[1]) * (point[0] - p[0])

        kept = []
        for start, end in zip(subject, subject[1:] + subject[:1], strict=True):
            at_start, at_end = side(start), side(end)
            if (at_start >= 0.0) != (at_end >= 0.0):
                kept.append(start + (end - start) * at_start / (at_start - at_end))
            if at_end >= 0.0:
                kept.append(end)
        subject = kept
        if not subject:
            return 0.0
    x, y = np.array(subject).T
    return 0.5 * abs(float(x @ np.roll(y, -1) - y @ np.roll(x, -1)))


def scaled(agent: np.ndarray, metres: float) -> np.ndarray:
    other = agent.copy()
    other[[A.LENGTH_M, A.WIDTH_M]] += metres
    return other


@pytest.mark.parametrize("seed", range(400))
def test_random_boxes_overlap_where_their_polygons_share_an_area(seed):
    g = np.random.default_rng(seed)
    a = box(0.0, 0.0, g.uniform(-4, 4), g.uniform(0.3, 15), g.uniform(0.3, 4))
    b = box(*g.uniform(-7, 7, 2), g.uniform(-4, 4), g.uniform(0.3, 15), g.uniform(0.3, 4))
    apart, together = shared_area(scaled(a, 1e-6), b) == 0.0, shared_area(a, b) > 0.0
    if apart or together:  # else they touch within a micrometre
        assert overlap(a, b) == together


def test_the_random_boxes_are_a_good_mix():
    overlapping = 0
    for seed in range(400):
        g = np.random.default_rng(seed)
        a = box(0.0, 0.0, g.uniform(-4, 4), g.uniform(0.3, 15), g.uniform(0.3, 4))
        b = box(*g.uniform(-7, 7, 2), g.uniform(-4, 4), g.uniform(0.3, 15), g.uniform(0.3, 4))
        overlapping += overlap(a, b)
    assert 100 < overlapping < 300


@pytest.mark.parametrize("seed", range(100))
def test_overlap_is_symmetric(seed):
    g = np.random.default_rng(1000 + seed)
    a, b = box(*g.uniform(-3, 3, 2), g.uniform(-4, 4)), box(*g.uniform(-3, 3, 2), g.uniform(-4, 4))
    assert overlap(a, b) == overlap(b, a)


@pytest.mark.parametrize(
    ("x", "y", "expected"),
    [
        (4.0, 0.0, True),
        (4.001, 0.0, False),
        (0.0, 2.0, True),
        (0.0, -2.001, False),
        (4.0, 2.0, True),
        (3.9, 1.9, True),
    ],
)
def test_boxes_that_touch_collide(x, y, expected):
    assert overlap(box(0.0, 0.0), box(x, y)) is expected


def test_a_box_within_another_collides():
    assert overlap(box(0.0, 0.0, 0.3, 20.0, 10.0), box(1.0, 1.0, 1.0, 0.5, 0.5))
    assert overlap(box(1.0, 1.0, 1.0, 0.5, 0.5), box(0.0, 0.0, 0.3, 20.0, 10.0))


def test_a_corner_that_points_at_a_side_collides_when_it_reaches_it():
    diagonal = math.sqrt(2.0)  # half the diagonal of a box of 2 by 2, turned by 45 degrees
    assert overlap(box(0.0, 0.0), box(2.0 + diagonal - 1e-9, 0.0, math.pi / 4, 2.0, 2.0))
    assert not overlap(box(0.0, 0.0), box(2.0 + diagonal + 1e-9, 0.0, math.pi / 4, 2.0, 2.0))


def test_boxes_whose_bounding_boxes_overlap_can_be_apart():
    assert not overlap(box(0.0, 0.0, math.pi / 4, 10.0, 0.5), box(2.0, -2.0, math.pi / 4, 10.0, 0.5))
    assert not overlap(box(0.0, 0.0, math.pi / 4, 10.0, 1.0), box(3.4, -1.0, -math.pi / 4, 1.0, 1.0))


def test_everyone_in_a_pile_up_is_marked_and_nobody_else():
    agents = np.array([box(0.0, 0.0), box(3.0, 0.0), box(6.0, 0.5, 0.2), box(30.0, 0.0)])
    agents[3, A.COLLISION] = 1.0  # from a step before
    mark_collisions(agents, 4)
    assert agents[:, A.COLLISION].tolist() == [1.0, 1.0, 1.0, 0.0]


def test_vehicles_that_have_left_the_world_collide_with_nobody():
    agents = np.array([box(0.0, 0.0), box(1.0, 0.0)])
    agents[1, A.ACTIVE] = 0.0
    mark_collisions(agents, 2)
    assert agents[:, A.COLLISION].tolist() == [0.0, 0.0]


def test_rows_beyond_the_count_collide_with_nobody():
    agents = np.array([box(0.0, 0.0), box(1.0, 0.0)])
    mark_collisions(agents, 1)
    assert agents[0, A.COLLISION] == 0.0
