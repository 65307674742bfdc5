"""When a conflict begins, of vehicles that move as a test says."""

import math

import numpy as np
import pytest

from service.analysis.prevention.onset import BRIDGED_S, _first, onset_of
from tests.service.analysis.failures.conftest import Moves, at_speed, play

__all__ = ["play"]  # a fixture


@pytest.fixture(scope="module")
def running_into_another(play):
    """The ego at 20 m/s, 60 m between the boxes behind one at 10 m/s: they touch after 6 s."""
    return play([Moves(2, at_speed(100.0, 20.0)), Moves(2, at_speed(164.5, 10.0))], seconds=8.0)


def test_a_conflict_begins_where_the_boxes_would_touch_within_the_time(running_into_another):
    onset = onset_of(running_into_another, 1, ttc_s=4.0)
    assert onset.time_s == pytest.approx(2.0, abs=0.11)
    assert onset.ttc_s == pytest.approx(4.0, abs=0.11)
    assert onset.time_s + onset.before_s == pytest.approx(6.0, abs=0.11)
    assert onset.step == round(onset.time_s * 10)
    assert onset_of(running_into_another, 1, ttc_s=2.0).time_s == pytest.approx(4.0, abs=0.11)


def test_an_infinite_time_means_the_start(running_into_another):
    assert onset_of(running_into_another, 1, math.inf).step == 0


def test_short_gaps_do_not_end_a_conflict_and_long_ones_do():
    time_s = np.arange(60) * 0.1
    times = np.full(60, 3.0)
    times[:10] = math.inf
    times[30 : 30 + round(BRIDGED_S * 10) - 1] = math.inf
    assert _first(times, time_s, 4.0, 59) == 10
    times[30:45] = math.inf
    assert _first(times, time_s, 4.0, 59) == 45
    assert _first(np.full(60, math.inf), time_s, 4.0, 59) == 58  # nobody was seen to close in


def test_background_traffic_is_judged_by_the_rays(running_into_another):
    onset = onset_of(running_into_another, None, ttc_s=4.0)
    assert onset.other is None
    assert onset.step > 0
