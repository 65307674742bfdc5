"""What the lidar ego does in an emergency, on scans of vehicles placed by hand."""

import math

import numpy as np
import pytest

from policies import layout as O
from policies.drivers import load_drivers, save_drivers
from policies.egos import Observation
from policies.egos.emergency import FALL_BACK_MPS2, HARDEST_MPS2, intervene
from policies.egos.lidar import LidarEgo
from service.world import agents as A
from service.world.sensors.lidar import beam_directions, scan

LANE_M = 3.66
BEAMS = beam_directions(O.BEAMS)


def scanned(
    *others: tuple[float, float, float], speed: float = 20.0, offset: float = 0.0, across: float = 0.0
) -> np.ndarray:
    """What the ego perceives of others: metres ahead, metres to the left, m/s; all move `across` m/s to the left."""
    agents = np.zeros((1 + len(others), A.COLUMNS))
    for row, (ahead, left, v) in zip(agents, [(0.0, 0.0, speed), *others], strict=True):
        drift = across if row is not agents[0] and v > 0.0 else 0.0
        heading = math.asin(drift / v) if v > 0.0 else 0.0
        row[A.X_M], row[A.Y_M], row[A.SPEED_MPS] = ahead, left, v
        row[A.SIN], row[A.COS] = math.sin(heading), math.cos(heading)
        row[A.LENGTH_M], row[A.WIDTH_M], row[A.ACTIVE] = 4.5, 1.8, 1.0
    agents[0, [A.SIN, A.COS]] = 0.0, 1.0
    seen = np.zeros(O.OBSERVATION_SIZE)
    seen[[O.SPEED_MPS, O.LENGTH_M, O.WIDTH_M, O.LANE_OFFSET_M]] = speed, 4.5, 1.8, offset
    scan(
        agents,
        len(agents),
        0,
        BEAMS,
        O.LIDAR_RANGE_M,
        seen[O.RANGE_M : O.RANGE_RATE_MPS],
        seen[O.RANGE_RATE_MPS :],
    )
    return seen


def test_it_leaves_the_policy_alone_on_a_free_road_and_beside_those_who_keep_their_lanes():
    free = scanned()
    assert intervene(free, 0.7, 0.01) == (0.7, 0.01)
    for ahead in np.arange(-12.0, 40.0, 0.5):
        busy = scanned((ahead, LANE_M, 16.0), (ahead + 3.0, -LANE_M, 22.0), (45.0, 0.0, 20.0))
        assert intervene(busy, 0.7, 0.01) == (0.7, 0.01)


def test_it_brakes_for_a_slower_leader_the_harder_the_nearer_and_never_less_than_the_policy():
    far, near = (
        intervene(scanned((30.0, 0.0, 12.0)), 0.5, 0.0)[0],
        intervene(scanned((14.0, 0.0, 12.0)), 0.5, 0.0)[0],
    )
    assert near < far < -1.5
    assert intervene(scanned((8.0, 0.0, 5.0)), 0.5, 0.0)[0] == -HARDEST_MPS2
    assert intervene(scanned((30.0, 0.0, 12.0)), -8.0, 0.0)[0] == -8.0
    assert intervene(scanned((15.0, 0.0, 21.0)), 0.5, 0.0)[0] == 0.5  # it drives away


@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize("overlap", [0.05, 0.3, 0.8])
@pytest.mark.parametrize("slower", [2.0, 4.0, 5.0])
def test_it_stops_closing_in_on_one_that_straddles_the_marking_before_they_touch(side, overlap, slower):
    """The ego keeps its line; only beam 1 or 19 ever hits the other, from some 6 m on."""
    gap, speed, other = 20.0, 20.0, 20.0 - slower
    braked = 0.0
    while gap > 0.0 and speed > other:
        action, _ = intervene(scanned((gap + 4.5, side * (1.8 - overlap), other), speed=speed), 0.0, 0.0)
        braked = min(braked, action)
        gap -= 0.1 * (speed - other)
        speed += 0.1 * action
    assert gap > 0.2
    assert -HARDEST_MPS2 <= braked < 0.0


def test_it_moves_over_for_one_too_near_beside_but_not_out_of_its_lane():
    _, away = intervene(scanned((0.0, 2.2, 20.0)), 0.0, 0.0)
    assert away < 0.0
    assert intervene(scanned((0.0, 2.2, 20.0), offset=-0.9), 0.0, 0.0)[1] == 0.0
    assert intervene(scanned((0.0, 2.2, 20.0), (0.0, -2.2, 20.0)), 0.0, 0.0)[1] == pytest.approx(
        0.0, abs=1e-12
    )


def test_it_falls_back_behind_one_that_is_too_near_and_ahead_of_its_middle():
    assert intervene(scanned((3.0, 2.1, 20.0)), 0.5, 0.0)[0] == -FALL_BACK_MPS2
    assert intervene(scanned((-1.0, 2.1, 20.0)), 0.5, 0.0)[0] == 0.5  # it is beside the rear half, too


def test_braking_ends_at_a_standstill():
    assert intervene(scanned((5.3, 0.0, 0.0), speed=0.1), 0.5, 0.0)[0] == pytest.approx(-0.5)
    assert intervene(scanned((5.3, 0.0, 0.0), speed=0.02), 0.5, 0.0)[0] == pytest.approx(-0.2)


def test_a_mirrored_scan_gives_the_mirrored_action_to_the_bit():
    rng = np.random.default_rng(3)
    mirror = -np.arange(O.BEAMS) % O.BEAMS
    for _ in range(200):
        others = [(rng.uniform(-10, 30), rng.uniform(-5, 5), rng.uniform(8, 22)) for _ in range(3)]
        seen = scanned(
            *others, speed=rng.uniform(8, 22), offset=rng.uniform(-1, 1), across=rng.uniform(-0.5, 0.5)
        )
        image = seen.copy()
        image[O.LANE_OFFSET_M] *= -1.0
        image[O.RANGE_M : O.RANGE_RATE_MPS] = seen[O.RANGE_M : O.RANGE_RATE_MPS][mirror]
        image[O.RANGE_RATE_MPS :] = seen[O.RANGE_RATE_MPS :][mirror]
        acceleration, turn = intervene(seen, 0.3, 0.02)
        assert intervene(image, 0.3, -0.02) == (acceleration, -turn)


def test_the_weights_say_whether_an_ego_has_it(tmp_path):
    model = load_drivers("ego-lidar-paper")
    assert not model.emergency
    arrays = {
        name: getattr(model, name) for name in ("w1", "b1", "w2", "b2", "mu0", "sigma0", "action_scale")
    }
    path = save_drivers(tmp_path / "ego-mine.safetensors", arrays, {"name": "ego-mine"}, emergency=True)
    mine, bare = LidarEgo(load_drivers(path)), LidarEgo(model)
    danger = scanned((8.0, 0.0, 5.0))
    plain = bare.act(Observation(danger, 0.0))
    assert mine.act(Observation(danger, 0.0)) == intervene(danger, *plain)
    assert mine.act(Observation(danger, 0.0))[0] == -HARDEST_MPS2
