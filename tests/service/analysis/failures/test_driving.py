"""How drivers drove in a rollout, and what a player is given of it: vehicles that move as a test says."""

import dataclasses
import json

import msgspec
import numpy as np
import pytest

from service.analysis.failures.driving import driving_of
from service.analysis.failures.play import playback_of
from service.analysis.failures.playback import Playback
from service.world import agents as A
from tests.service.analysis.failures.conftest import Moves, across, at_speed


@pytest.fixture(scope="module")
def trace(play):
    """The ego alone in lane 1; a follower 20 m behind a leader in lane 3; and one that changes from lane 5 to 4."""
    return play(
        [
            Moves(0, at_speed(100.0, 15.0)),
            Moves(2, at_speed(100.0, 20.0)),
            Moves(2, at_speed(115.0, 20.0)),
            Moves(4, at_speed(50.0, 15.0), across(1.0, 1.0)),
        ],
        seconds=6.0,
    )


def test_lane_changes_headways_and_speed_are_counted(trace):
    driving = driving_of(trace)
    states = len(trace.time_s)
    assert driving.lane_changes == 1
    assert driving.states == 3 * states
    assert driving.following == driving.close == states  # one follows, 15 m at 20 m/s behind
    assert driving.headway_s / driving.following == pytest.approx(0.75, abs=0.01)
    assert driving.km == pytest.approx(0.001 * 6.0 * (20 + 20 + 15), rel=0.01)
    assert driving.speed_mps / driving.states == pytest.approx(55 / 3, rel=0.01)
    assert driving.hard_brakes == 0


def test_brakings_are_counted_once_each_and_not_of_the_ego_or_one_taken_over(trace):
    agents = trace.agents.copy()
    agents[10:15, 1, A.ACCELERATION_MPS2] = -4.0
    agents[30:32, 1, A.ACCELERATION_MPS2] = -3.0
    agents[20:25, 0, A.ACCELERATION_MPS2] = -5.0  # the ego
    agents[20:25, 3, A.ACCELERATION_MPS2] = -5.0
    agents[:, 3, A.TAKEN_OVER] = 1.0
    driving = driving_of(dataclasses.replace(trace, agents=agents))
    assert driving.hard_brakes == 2
    assert driving.lane_changes == 0  # the one that changed lanes was taken over


def test_what_a_player_is_given(trace, i80):
    played = playback_of(trace, i80, 0.5, 1, 20)
    assert [track.role for track in played.tracks] == ["ego", "threat", "other", "other"]
    assert played.time_s[-1] == pytest.approx(6.0)
    assert played.tracks[1].station_m[0] == pytest.approx(100.0, abs=0.01)
    assert max(abs(h) for h in played.tracks[0].heading_rad) < 0.01
    assert len(played.ray_m) == len(played.time_s)
    assert len(played.ray_m[0]) == len(played.ray_rad) == 20
    assert [line.kind for line in played.road].count("edge") == 2
    assert min(played.road_station_m) <= 50.0 <= max(played.road_station_m)
    assert msgspec.convert(json.loads(msgspec.json.encode(played)), Playback) == played


def test_only_the_states_asked_for_are_played(trace, i80):
    played = playback_of(trace, i80, 0.5, None, 0, np.array([3, 5, 7]))
    assert played.time_s == pytest.approx((0.3, 0.5, 0.7))
    assert played.ray_m == ()
    assert 0 <= played.worst < 3
