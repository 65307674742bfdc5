"""The lidar against an independent ray caster: rays against the four sides of each box, in plain numpy."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from policies.layout import BEAMS, LIDAR_RANGE_M
from service.world import agents as A
from service.world.sensors.lidar import beam_directions, ray_box, scan

Scene = list[tuple[float, float, float, float, float, float]]  # x, y, heading, speed, length, width


def agents_of(scene: Scene) -> np.ndarray:
    agents = np.zeros((len(scene), A.COLUMNS))
    agents[:, A.X_M : A.WIDTH_M + 1] = scene
    agents[:, A.COS], agents[:, A.SIN] = np.cos(agents[:, A.HEADING_RAD]), np.sin(agents[:, A.HEADING_RAD])
    agents[:, A.ACTIVE] = 1.0
    return agents


def scanned(agents: np.ndarray, own: int = 0, beams: int = BEAMS, limit_m: float = LIDAR_RANGE_M):
    ranges, rates = np.full(beams, np.nan), np.full(beams, np.nan)
    scan(agents, len(agents), own, beam_directions(beams), limit_m, ranges, rates)
    return ranges, rates


def corners(x: float, y: float, heading: float, length: float, width: float) -> np.ndarray:
    along = np.array([math.cos(heading), math.sin(heading)])
    left = np.array([-along[1], along[0]])
    signs = [(1, 1), (-1, 1), (-1, -1), (1, -1)]
    return np.array([[x, y] + a * length / 2 * along + b * width / 2 * left for a, b in signs])


def cast(scene: Scene, own: int, beams: int, limit_m: float) -> tuple[np.ndarray, np.ndarray]:
    """Ranges and rates by cutting each ray with each side of each box."""
    x, y, heading, speed, *_ = scene[own]
    ranges, rates = np.full(beams, limit_m), np.zeros(beams)
    velocity = speed * np.array([math.cos(heading), math.sin(heading)])
    for b in range(beams):
        angle = heading + 2.0 * math.pi * b / beams
        ray = np.array([math.cos(angle), math.sin(angle)])
        for j, (ox, oy, oh, ov, length, width) in enumerate(scene):
            if j == own:
                continue
            box = corners(ox, oy, oh, length, width) - [x, y]
            sides = np.roll(box, -1, axis=0) - box
            inside = (sides[:, 0] * -box[:, 1] - sides[:, 1] * -box[:, 0] >= 0.0).all()
            hit = 0.0 if inside else math.inf
            for start, side in zip(box, sides, strict=True):
                det = side[0] * ray[1] - side[1] * ray[0]
                if abs(det) < 1e-15:
                    continue
                t = (side[0] * start[1] - side[1] * start[0]) / det
                u = (ray[0] * start[1] - ray[1] * start[0]) / det
                if t >= 0.0 and 0.0 <= u <= 1.0:
                    hit = min(hit, t)
            if hit < ranges[b]:
                ranges[b] = hit
                rates[b] = (ov * np.array([math.cos(oh), math.sin(oh)]) - velocity) @ ray
    return ranges, rates


def grazes(scene: Scene, own: int, beams: int) -> np.ndarray:
    """Beams that pass a box's corner within 1e-7 rad, where the last bit decides between hit and miss."""
    x, y, heading, *_ = scene[own]
    directions = heading + 2.0 * math.pi * np.arange(beams) / beams
    close = np.zeros(beams, dtype=bool)
    for j, (ox, oy, oh, _, length, width) in enumerate(scene):
        if j != own:
            for cx, cy in corners(ox, oy, oh, length, width):
                angle = math.atan2(cy - y, cx - x) - directions
                close |= np.abs((angle + math.pi) % (2 * math.pi) - math.pi) < 1e-7
    return close


def random_scene(seed: int, spread_m: float) -> Scene:
    g = np.random.default_rng(seed)
    return [
        (
            *g.uniform(-spread_m, spread_m, 2),
            g.uniform(-4.0, 4.0),
            g.uniform(0.0, 30.0),
            g.uniform(3.0, 15.0),
            2.0,
        )
        for _ in range(6)
    ]


@pytest.mark.parametrize("seed", range(60))
@pytest.mark.parametrize("spread_m", [10.0, 40.0, 150.0])
def test_ranges_and_rates_are_those_of_the_ray_caster(seed, spread_m):
    scene = random_scene(seed, spread_m)
    for own in (0, 3):
        ranges, rates = scanned(agents_of(scene), own)
        clear = ~grazes(scene, own, BEAMS)
        expected_ranges, expected_rates = cast(scene, own, BEAMS, LIDAR_RANGE_M)
        assert ranges[clear] == pytest.approx(expected_ranges[clear], rel=0, abs=1e-9)
        assert rates[clear] == pytest.approx(expected_rates[clear], rel=0, abs=1e-9)


def test_the_random_scenes_hold_hits_misses_and_boxes_around_the_sensor():
    ranges = np.concatenate(
        [scanned(agents_of(random_scene(seed, s)))[0] for seed in range(60) for s in (10.0, 40.0)]
    )
    assert (ranges == LIDAR_RANGE_M).sum() > 100
    assert (ranges == 0.0).sum() > 20
    assert ((ranges > 0.0) & (ranges < LIDAR_RANGE_M)).sum() > 500


sizes = st.floats(0.3, 20.0)
places = st.floats(-60.0, 60.0)


@settings(max_examples=150, deadline=None, derandomize=True)
@given(x=places, y=places, heading=st.floats(-7.0, 7.0), own=st.floats(-7.0, 7.0), length=sizes, width=sizes)
def test_one_box_anywhere_is_seen_as_by_the_ray_caster(x, y, heading, own, length, width):
    scene = [(0.0, 0.0, own, 12.0, 4.5, 1.8), (x, y, heading, 9.0, length, width)]
    clear = ~grazes(scene, 0, 36)
    expected, _ = cast(scene, 0, 36, math.inf)
    assume(not 0.0 < expected.min() < 1e-6)  # the sensor sits on the box's border
    ranges, _ = scanned(agents_of(scene), beams=36, limit_m=math.inf)
    assert ranges[clear] == pytest.approx(expected[clear], rel=0, abs=1e-9)


EGO = (0.0, 0.0, 0.0, 10.0, 4.5, 1.8)


def test_beam_0_points_ahead_and_the_next_ones_to_the_left():
    directions = beam_directions(4)
    assert directions == pytest.approx(np.array([[1, 0], [0, 1], [-1, 0], [0, -1]]), abs=2e-16)
    assert np.hypot(*beam_directions(20).T) == pytest.approx(1.0, abs=3e-16)


def test_a_vehicle_dead_ahead_is_seen_at_its_rear_bumper():
    ranges, rates = scanned(agents_of([EGO, (30.0, 0.0, 0.0, 4.0, 5.0, 1.8)]))
    assert ranges[0] == 27.5
    assert rates[0] == -6.0
    assert (ranges[1:] == LIDAR_RANGE_M).all()
    assert (rates[1:] == 0.0).all()


def test_a_vehicle_to_the_left_is_seen_by_beam_5():
    ranges, rates = scanned(agents_of([EGO, (0.0, 3.7, 0.0, 13.0, 4.5, 1.8)]))
    assert ranges[5] == pytest.approx(3.7 - 0.9, abs=1e-12)
    assert rates[5] == pytest.approx(0.0, abs=1e-12)  # overtaking is across this beam
    assert rates[4] > 0.5  # pulls away ahead
    assert rates[6] < -0.5  # and comes up from behind


def test_the_nearer_of_two_vehicles_hides_the_other():
    ranges, rates = scanned(
        agents_of([EGO, (60.0, 0.0, 0.0, 0.0, 4.0, 2.0), (30.0, 0.0, 0.0, 12.0, 4.0, 2.0)])
    )
    assert ranges[0] == 28.0
    assert rates[0] == 2.0


def test_a_sensor_inside_a_box_has_range_0_on_every_beam():
    ranges, _ = scanned(agents_of([EGO, (0.5, -0.3, 0.4, 10.0, 12.0, 2.5)]))
    assert (ranges == 0.0).all()


def test_a_narrow_vehicle_between_two_beams_is_not_seen():
    # beams are 18 degrees apart: at 40 m there are 12.6 m between them
    angle = math.radians(9.0)
    ranges, rates = scanned(
        agents_of([EGO, (40.0 * math.cos(angle), 40.0 * math.sin(angle), 0.0, 0.0, 4.5, 1.8)])
    )
    assert (ranges == LIDAR_RANGE_M).all()
    assert (rates == 0.0).all()


@pytest.mark.parametrize(("side", "hit"), [(0.999, True), (1.0, True), (1.001, False)])
def test_a_ray_along_a_box_s_side_touches_it(side, hit):
    """Parallel to one pair of sides; exactly on the side counts as a touch."""
    ranges, _ = scanned(agents_of([EGO, (20.0, side, 0.0, 0.0, 4.0, 2.0)]))
    assert bool(ranges[0] == 18.0) is hit


@pytest.mark.parametrize("tilt", [0.0, 1e-13, 1e-11, 1e-8])
def test_a_ray_nearly_parallel_to_a_side_is_cut_at_the_bumper(tilt):
    assert ray_box(math.cos(tilt), math.sin(tilt), 50.0, 0.5, 2.0, 1.0) == pytest.approx(48.0, abs=1e-9)
    assert ray_box(math.cos(tilt), math.sin(tilt), 50.0, 1.5, 2.0, 1.0) == math.inf
    assert ray_box(math.sin(tilt), math.cos(tilt), 0.5, 50.0, 1.0, 2.0) == pytest.approx(48.0, abs=1e-9)


def test_a_box_behind_a_ray_is_not_hit():
    assert ray_box(1.0, 0.0, -10.0, 0.0, 2.0, 1.0) == math.inf
    assert ray_box(-1.0, 0.0, -10.0, 0.0, 2.0, 1.0) == 8.0


@pytest.mark.parametrize(("bumper_m", "seen"), [(99.9, True), (100.0, False), (100.1, False)])
def test_nothing_is_seen_beyond_the_limit(bumper_m, seen):
    ranges, rates = scanned(agents_of([EGO, (bumper_m + 2.0, 0.0, 0.0, 0.0, 4.0, 2.0)]))
    assert ranges[0] == pytest.approx(bumper_m if seen else 100.0, abs=1e-12)
    assert bool(rates[0] != 0.0) is seen


def test_a_long_truck_whose_centre_is_beyond_the_limit_is_seen():
    ranges, _ = scanned(agents_of([EGO, (110.0, 0.0, 0.0, 0.0, 24.0, 2.5)]))
    assert ranges[0] == 98.0


def test_vehicles_that_have_left_the_world_are_not_seen():
    agents = agents_of([EGO, (30.0, 0.0, 0.0, 4.0, 5.0, 1.8)])
    agents[1, A.ACTIVE] = 0.0
    assert (scanned(agents)[0] == LIDAR_RANGE_M).all()


def test_rows_beyond_the_count_are_not_seen():
    agents = agents_of([EGO, (30.0, 0.0, 0.0, 4.0, 5.0, 1.8)])
    ranges, rates = np.zeros(4), np.zeros(4)
    scan(agents, 1, 0, beam_directions(4), 100.0, ranges, rates)
    assert (ranges == 100.0).all()


def test_a_rotated_scene_is_seen_the_same():
    scene = random_scene(9, 30.0)
    turn = 2.1
    c, s = math.cos(turn), math.sin(turn)
    turned = [(c * x - s * y + 1e3, s * x + c * y - 2e3, h + turn, *rest) for x, y, h, *rest in scene]
    ranges, rates = scanned(agents_of(scene))
    turned_ranges, turned_rates = scanned(agents_of(turned))
    assert turned_ranges == pytest.approx(ranges, abs=1e-9)
    assert turned_rates == pytest.approx(rates, abs=1e-9)


@pytest.mark.parametrize("beams", [0, -3])
def test_a_lidar_without_beams_is_refused(beams):
    with pytest.raises(ValueError, match=f"at least one beam, not {beams}"):
        beam_directions(beams)
