import dataclasses

import numpy as np
import pytest

from service.analysis.failures.motion import motion_of
from service.world import agents as A
from tests.service.analysis.failures.conftest import Moves, across, at_speed


def test_gaps_speeds_and_lane_changes_are_those_that_were_driven(play, i80):
    ego = Moves(3, at_speed(300, 20.0))
    other = Moves(2, at_speed(333, 14.0, -1.0), across(-1, begin_s=1.0, takes_s=2.0))
    trace = play([ego, other])
    motion = motion_of(trace, 20, i80)
    assert motion is not None
    assert trace.rollout.outcome == "collision"
    t = motion.time_s - 0.1  # the last state before the boxes met
    assert motion.ahead_m == pytest.approx(other.along(t) - ego.along(t), abs=0.3)
    assert motion.gap_along_m == pytest.approx(motion.ahead_m - 4.5)
    assert motion.left_m == pytest.approx(0.0, abs=0.2)
    assert motion.closing_along_mps == pytest.approx(20.0 - (14.0 - t), abs=0.2)
    assert (motion.other_lanes_left, motion.ego_lanes_left) == (-1, 0)
    assert motion.same_lane
    assert not motion.same_lane_before
    assert motion.other_braking_mps2 == pytest.approx(1.0, abs=0.05)
    assert motion.ego_braking_mps2 == pytest.approx(0.0, abs=1e-6)
    assert motion.ray_deg == pytest.approx(0.0, abs=5.0)


def test_the_moment_is_that_of_the_scenarios_own_measure(play, i80):
    trace = play([Moves(3, at_speed(300, 20.0)), Moves(2, at_speed(330, 12.0))])
    other = dataclasses.replace(trace, measured=np.arange(len(trace.time_s))[::-1].astype(float))
    motion = motion_of(other, 20, i80)
    assert motion is not None
    assert motion.time_s == trace.time_s[-1]


def test_background_traffic_that_comes_closest_has_no_motion(play, i80):
    trace = play([Moves(3, at_speed(300, 20.0)), Moves(3, at_speed(330, 12.0))], seconds=1.0)
    nearer = trace.ttc_s.copy()
    nearer[5] = 0.01
    assert motion_of(dataclasses.replace(trace, ttc_s=nearer, measured=nearer), 20, i80) is None


def test_vehicles_that_left_the_road_are_not_seen(play, i80):
    trace = play([Moves(3, at_speed(300, 20.0)), Moves(3, at_speed(330, 12.0))], seconds=1.0)
    agents = trace.agents.copy()
    agents[:, 1, A.ACTIVE] = 0.0
    nobody = np.full(len(trace.time_s), np.inf)
    gone = dataclasses.replace(trace, agents=agents, ttc_s=nobody, measured=nobody)
    assert motion_of(gone, 20, i80) is None


@pytest.mark.parametrize(("lane", "blocked"), [(2, (True, False)), (4, (False, True)), (1, (False, False))])
def test_a_lane_is_blocked_where_a_vehicle_is_beside(lane, blocked, play, i80):
    trace = play(
        [
            Moves(3, at_speed(300, 20.0)),
            Moves(3, at_speed(330, 12.0)),
            Moves(lane, at_speed(301, 20.0)),
        ]
    )
    motion = motion_of(trace, 20, i80)
    assert motion is not None
    assert (motion.left_blocked, motion.right_blocked) == blocked


def test_a_lane_that_is_not_there_is_blocked(play, i80):
    motion = motion_of(play([Moves(0, at_speed(300, 20.0)), Moves(0, at_speed(330, 12.0))]), 20, i80)
    assert motion is not None
    assert motion.left_blocked
    assert not motion.right_blocked
