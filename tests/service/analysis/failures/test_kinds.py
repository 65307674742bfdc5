"""What is seen on the road gets the name that people give it."""

import pytest

from service.analysis.failures.kinds import NAMES, kind_of
from service.analysis.failures.motion import motion_of
from tests.service.analysis.failures.conftest import Moves, across, at_speed

LANE = 3
SLOW, FAST = 12.0, 20.0


def mirrored(kind: str) -> str:
    swap = {"left": "right", "right": "left"}
    first, _, last = kind.rpartition("-")
    return f"{first}-{swap[last]}" if last in swap else kind


def beside(lane: int, speed: float = FAST) -> Moves:
    return Moves(lane, at_speed(300.0, speed))


SITUATIONS = {
    "rear-end": [Moves(LANE, at_speed(300, FAST)), Moves(LANE, at_speed(330, SLOW))],
    "rear-end-braking": [Moves(LANE, at_speed(300, FAST)), Moves(LANE, at_speed(320, FAST, -5.0))],
    "boxed-in": [
        Moves(LANE, at_speed(300, FAST)),
        Moves(LANE, at_speed(330, SLOW)),
        beside(LANE - 1),
        beside(LANE + 1),
    ],
    "cut-in-left": [
        Moves(LANE, at_speed(300, FAST)),
        Moves(LANE - 1, at_speed(333, 14), across(-1, begin_s=1.0)),
    ],
    "ego-lane-change-front": [
        Moves(LANE, at_speed(300, FAST), across(1, begin_s=0.5)),
        Moves(LANE - 1, at_speed(333, SLOW)),
    ],
    "rear-ended": [Moves(LANE, at_speed(330, SLOW)), Moves(LANE, at_speed(300, FAST))],
    "ego-cut-in": [
        Moves(LANE, at_speed(333, SLOW), across(1, begin_s=0.5)),
        Moves(LANE - 1, at_speed(300, FAST)),
    ],
    "side-swipe-left": [
        Moves(LANE, at_speed(300, FAST)),
        Moves(LANE - 1, at_speed(300, FAST), across(-1, begin_s=1.0)),
    ],
    "ego-drift-left": [
        Moves(LANE, at_speed(300, FAST), across(1, begin_s=1.0)),
        Moves(LANE - 1, at_speed(300, FAST)),
    ],
    "pass-left": [Moves(LANE, at_speed(300, FAST)), Moves(LANE - 1, at_speed(320, SLOW))],
    "passed-left": [Moves(LANE, at_speed(320, SLOW)), Moves(LANE - 1, at_speed(300, FAST))],
}


@pytest.mark.parametrize("kind", SITUATIONS)
def test_a_situation_is_named_as_people_name_it(kind, play, i80):
    motion = motion_of(play(SITUATIONS[kind]), 20, i80)
    assert motion is not None
    assert kind_of(motion) == kind
    assert motion.other == 1


@pytest.mark.parametrize("kind", SITUATIONS)
def test_the_mirror_image_has_the_mirrored_name(kind, play, i80):
    flipped = [Moves(2 * LANE - v.lane, v.along, lambda t, left=v.left: -left(t)) for v in SITUATIONS[kind]]
    motion = motion_of(play(flipped), 20, i80)
    assert motion is not None
    assert kind_of(motion) == mirrored(kind)


def test_every_kind_that_is_met_has_words():
    assert {mirrored(kind) for kind in SITUATIONS} | set(SITUATIONS) | {"other"} == set(NAMES)


def test_a_far_vehicle_in_another_lane_is_none_of_the_named_ways(play, i80):
    trace = play([Moves(LANE, at_speed(300, FAST)), Moves(LANE - 2, at_speed(360, SLOW))], seconds=0.5)
    motion = motion_of(trace, 360, i80)
    assert motion is not None
    assert kind_of(motion) == "other"
