"""Post-encroachment time: by hand, and against the paths' polygons at fine steps."""

from __future__ import annotations

import math

import cv2
import numpy as np
import pytest

from service.world import agents as A
from service.world.safety.measure import EncroachmentMonitor

DT = 0.1


@pytest.fixture
def pet(agents_of):
    """pet(*paths): f and trace of vehicles that drive (x, y, heading, speed) straight on for so many steps."""

    def measure(*paths, steps: int = 60) -> tuple[float, np.ndarray]:
        monitor = EncroachmentMonitor(steps, len(paths), 0, DT)
        monitor.reset()
        for k in range(steps + 1):
            monitor.see(agents_of(*[moved(p, k * DT) for p in paths]), len(paths), math.inf)
        return monitor.value(), monitor.trace()

    return measure


def moved(path, t: float):
    x, y, heading, speed = path
    return x + speed * t * math.cos(heading), y + speed * t * math.sin(heading), heading, speed


def test_a_follower_at_the_same_speed_is_its_gap_over_the_speed_behind(pet):
    f, trace = pet((0.0, 0.0, 0.0, 15.0), (-24.5, 0.0, 0.0, 15.0))
    assert f == pytest.approx(20.0 / 15.0)
    assert trace[0] == math.inf  # nobody has been anywhere yet
    assert trace[-1] == pytest.approx(20.0 / 15.0)


def test_it_does_not_matter_who_was_there_first(pet):
    assert pet((0.0, 0.0, 0.0, 15.0), (24.5, 0.0, 0.0, 15.0))[0] == pytest.approx(20.0 / 15.0)


def test_paths_that_never_meet_have_none(pet):
    assert pet((0.0, 0.0, 0.0, 15.0), (-24.5, 3.6, 0.0, 15.0))[0] == math.inf


def test_a_crash_is_zero(pet):
    assert pet((0.0, 0.0, 0.0, 15.0), (20.0, 0.0, 0.0, 5.0))[0] == 0.0


def test_a_vehicle_that_left_the_road_leaves_its_past_behind(agents_of):
    monitor = EncroachmentMonitor(40, 2, 0, DT)
    monitor.reset()
    for k in range(41):
        agents = agents_of((0.0 + 1.5 * k, 0.0, 0.0, 15.0), (24.5 + 1.5 * k, 0.0, 0.0, 15.0))
        agents[1, A.ACTIVE] = 1.0 if k < 10 else 0.0
        monitor.see(agents, 2, math.inf)
    assert monitor.trace()[20] == pytest.approx(20.0 / 15.0)


@pytest.mark.parametrize("late_s", [0.7, 1.2, 2.5])
@pytest.mark.parametrize("angle", [math.pi / 2, -math.pi / 3])
def test_a_crossing_vehicle_is_as_late_as_its_polygon_is_at_the_other_s_place(pet, corners_of, late_s, angle):
    """The ego crosses (30, 0) after 2 s; the other's centre would do so `late_s` later."""
    other = (
        30.0 - 12.0 * (2.0 + late_s) * math.cos(angle),
        -12.0 * (2.0 + late_s) * math.sin(angle),
        angle,
        12.0,
    )
    paths = ((0.0, 0.0, 0.0, 15.0), other)
    fine = np.arange(0.0, 6.0, 0.02)
    boxes = [[corners_of(*moved(p, t)[:3], 4.5, 1.8).astype(np.float32) for t in fine] for p in paths]
    least = min(
        abs(i - j) * 0.02
        for i, a in enumerate(boxes[0])
        if 10.0 < a[:, 0].mean() < 50.0
        for j, b in enumerate(boxes[1])
        if abs(b.mean(axis=0) - a.mean(axis=0)).max() < 6.0 and cv2.intersectConvexConvex(a, b)[0] > 0.0
    )
    assert pet(*paths)[0] == pytest.approx(least, abs=DT)
