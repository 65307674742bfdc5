"""Time until the boxes touch, then the impact speed: order, sign, symmetry and continuity, on contacts made by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from service.errors import InputError
from service.evaluation.job import make_job
from service.world import agents as A
from service.world.safety.boxes import box_time_to_collision, time_until_touch
from service.world.safety.impact import time_or_impact
from service.world.safety.measure import with_measure
from service.world.scenario import load_scenario
from service.world.scenario.measures import IMPACT, MEASURES, measure_kind, span, unit_at
from service.world.sim.collision import overlap

EGO = (0.0, 0.0, 0.0, 20.0)
# where the other vehicle is at a contact, and the speed of one relative to the other
CONTACTS = {
    "runs into one ahead": ((4.4, 0.0, 0.0, 15.0), 5.0),
    "is run into from behind": ((-4.4, 0.3, 0.0, 28.0), 8.0),
    "touches one ahead": ((4.5, 0.0, 0.0, 20.0), 0.0),
    "side swipe": ((1.0, 1.75, 0.0, 17.0), 3.0),
    "side swipe by one that drifts": ((0.0, 1.7, -0.05, 20.0), 40.0 * math.sin(0.025)),
    "crossing": ((3.0, 0.0, math.pi / 2, 10.0), math.hypot(20.0, 10.0)),
    "head on": ((4.0, 0.0, math.pi, 15.0), 35.0),
}
APART = (4.6, 2.0, 0.0, 0.0)  # no contact: beyond the ego's corner


@pytest.mark.parametrize("other", CONTACTS, ids=str)
def test_a_contact_is_minus_the_relative_speed(agents_of, other):
    row, speed = CONTACTS[other]
    for agents in (agents_of(EGO, row), agents_of(EGO, (200.0, 0.0, 0.0, 0.0), row)):
        assert time_or_impact(agents, len(agents), 0) == pytest.approx(-speed)


def test_every_contact_is_worse_than_any_approach(agents_of):
    impacts = [time_or_impact(agents_of(EGO, row), 2, 0) for row, _ in CONTACTS.values()]
    approaches = [
        time_or_impact(agents_of(EGO, (4.5 + gap, 0.0, 0.0, 0.0)), 2, 0) for gap in (1e-9, 0.1, 5.0, 100.0)
    ]
    assert max(impacts) <= 0.0 < min(approaches)
    assert approaches == sorted(approaches)
    assert time_or_impact(agents_of(EGO, APART), 2, 0) == math.inf


def test_the_fastest_of_several_contacts_counts(agents_of):
    agents = agents_of(EGO, (4.4, 0.0, 0.0, 15.0), (-4.4, 0.0, 0.0, 29.0), (30.0, 0.0, 0.0, 0.0))
    assert time_or_impact(agents, 4, 0) == pytest.approx(-9.0)
    agents[2, A.ACTIVE] = 0.0
    assert time_or_impact(agents, 4, 0) == pytest.approx(-5.0)


places = st.tuples(
    st.floats(-12.0, 12.0), st.floats(-6.0, 6.0), st.floats(-math.pi, math.pi), st.floats(0.0, 35.0)
)


@settings(max_examples=200, deadline=None)
@given(other=places, heading=st.floats(-1.0, 1.0), speed=st.floats(0.0, 35.0))
def test_without_a_contact_it_is_the_box_time_to_collision_and_at_one_it_is_not_above_0(
    agents_of, other, heading, speed
):
    agents = agents_of((0.0, 0.0, heading, speed), other)
    touching = overlap(agents[0], agents[1])
    f = time_or_impact(agents, 2, 0)
    assert touching == (f <= 0.0) == (time_until_touch(agents[0], agents[1]) == 0.0)
    if not touching:
        assert f == box_time_to_collision(agents, 2, 0)


@settings(max_examples=100, deadline=None)
@given(other=places, heading=st.floats(-1.0, 1.0), speed=st.floats(0.0, 35.0))
def test_a_mirror_changes_nothing_and_neither_does_whose_view_it_is(agents_of, other, heading, speed):
    agents = agents_of((0.0, 0.0, heading, speed), other)
    mirrored = agents.copy()
    mirrored[:, [A.Y_M, A.HEADING_RAD, A.SIN]] *= -1.0
    assert time_or_impact(mirrored, 2, 0) == time_or_impact(agents, 2, 0)
    assert time_or_impact(agents, 2, 1) == pytest.approx(time_or_impact(agents, 2, 0), rel=1e-9)


def test_it_is_continuous_on_either_side_and_jumps_at_the_contact(agents_of):
    """By steps of 2 mm and 1 cm/s; the jump is from 0 to minus the relative speed."""
    gaps = np.arange(-0.5, 3.0, 0.002) + 1e-7
    f = np.array([time_or_impact(agents_of(EGO, (4.5 + gap, 0.4, 0.0, 15.0)), 2, 0) for gap in gaps])
    steps = np.abs(np.diff(f))
    jump = int(np.argmax(steps))
    assert gaps[jump] < 0.0 <= gaps[jump + 1]
    assert f[jump] == pytest.approx(-5.0)
    assert np.delete(steps, jump).max() < 0.001
    speeds = np.arange(0.0, 20.0, 0.01)
    impacts = np.array([time_or_impact(agents_of(EGO, (4.4, 0.4, 0.0, v)), 2, 0) for v in speeds])
    assert (np.diff(impacts) > 0.0).all()
    assert np.diff(impacts).max() < 0.011


def test_thresholds_below_0_are_for_measures_that_go_there():
    scenario = load_scenario("i80-paper-10s")
    assert make_job(with_measure(scenario, IMPACT), "idm", -5.0, "naive", 1, {}).gamma == -5.0
    assert make_job(scenario, "idm", 0.0, "naive", 1, {}).gamma == 0.0
    for measure in ("ttc", "box-ttc", "pet"):
        with pytest.raises(
            InputError, match=rf"threshold -5 s: the measure '{measure}' is never below 0.*ttc-impact"
        ):
            make_job(with_measure(scenario, measure), "idm", -5.0, "naive", 1, {})
    for measure in ("rss", "drac", "stl: always(ttc_s > 1)"):
        assert make_job(with_measure(scenario, measure), "idm", -5.0, "naive", 1, {}).gamma == -5.0


def test_a_value_has_the_unit_of_its_side():
    unit = measure_kind(IMPACT).unit
    assert [unit_at(unit, value) for value in (0.5, 0.0, -3.0)] == ["s", "m/s", "m/s"]
    assert unit_at(MEASURES["ttc"].unit, 0.0) == "s"
    assert span(unit, 0.0) == (-5.0, 1.0)
    assert span(unit, -4.0) == (-8.0, 1.0)
    assert span(unit, 2.0) == (-5.0, 4.0)
    assert span("s", 0.5) == (0.0, 1.0)
    assert span("m", -2.0) == (-4.0, 1.0)
