"""Coordinates of X that make drivers err, in rollouts: each moves what its name says."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
import pytest

import ce
from service.analysis.trace import Trace, record
from service.evaluation.job import Problem, make_job
from service.world import agents as A
from service.world.sim import minds as M
from tests.service.studies.human.test_rates import approach

EPSILON = 0.3
ROLLOUTS = 8
FAST = 1  # row of the first car that comes up behind a slow one

Drive = Callable[..., Trace]


@pytest.fixture(scope="module")
def drive() -> Iterator[Drive]:
    """Drives draw number i with some of the first fast car's coordinates given; nobody else looks away."""
    problem = Problem(make_job(approach(EPSILON), "idm", 0.0, "naive", 1, {}))
    names = list(problem.base.name_or_index)
    x, seeds = ce.draw(problem.base, 11, "estimate", 0, 0, ROLLOUTS)
    x[:, [i for i, name in enumerate(names) if name.endswith("glance_onset_s")]] = 50.0
    for name, value in {"fast1.speed_mps": 18.0, "fast1.station_m": 60.0, "slow1.speed_mps": 4.0}.items():
        x[:, names.index(name)] = value
    with problem.simulator() as simulator:

        def driven(i: int, **given: float) -> Trace:
            draw = x[i].copy()
            for name, value in given.items():
                draw[names.index(f"fast1.{name}")] = value
            return record(problem, simulator, draw, int(seeds[i]))

        yield driven


def first(flags: np.ndarray) -> int | None:
    found = np.flatnonzero(flags)
    return int(found[0]) if found.size else None


def test_a_longer_reaction_time_brakes_later(drive):
    later = []
    for i in range(ROLLOUTS):
        quick, slow = (first(drive(i, reaction_s=s).minds[:, FAST, M.BRAKE_MPS2] > 0.0) for s in (0.5, 2.0))
        if quick is not None:
            later.append((100 if slow is None else slow) - quick)  # None: the gap was safe again before
    assert len(later) >= ROLLOUTS // 2
    assert min(later) >= 5  # of 15 steps: the clock runs up to twice as fast in an urgent conflict


def test_a_glance_begins_and_ends_where_its_coordinates_say(drive):
    given = drive(0, glance_onset_s=0.21, glance_duration_s=2.5, glance_leak=0.0)
    away, without = (trace.minds[:, FAST, M.AWAY_S] > 0.0 for trace in (given, drive(0)))
    begun = first(away)
    assert begun in (2, 3)
    assert first(~away[begun:]) == pytest.approx(25, abs=1)
    assert not without[:28].any()


def test_in_a_conflict_only_a_glance_whose_leak_is_below_epsilon_begins(drive):
    tried = 0
    for i in range(ROLLOUTS):
        braking = first(drive(i).minds[:, FAST, M.BRAKE_MPS2] > 0.0)
        if braking is None or braking > 70:
            continue
        onset = 0.1 * (braking + 2) + 0.05
        leaks, held = (
            drive(i, glance_onset_s=onset, glance_duration_s=2.0, glance_leak=leak).minds[:, FAST]
            for leak in (EPSILON - 0.01, EPSILON + 0.01)
        )
        tried += 1
        assert leaks[-1, M.LEAKED] >= held[-1, M.LEAKED] + 1
        assert held[-1, M.RESISTED] >= 1
        assert leaks[braking + 4, M.AWAY_S] > 1.0
        assert held[braking + 4, M.AWAY_S] < 1.5
    assert tried >= ROLLOUTS // 2


def test_modes_of_the_noise_move_their_own_driver_to_the_left_and_ahead(drive):
    base = drive(0)
    left, ahead = drive(0, turn_rate_mode_1=2.5), drive(0, acceleration_mode_1=2.5)
    at = 15
    assert left.agents[at, FAST, A.OFFSET_M] > base.agents[at, FAST, A.OFFSET_M] + 0.005
    assert ahead.station_m[at, FAST] > base.station_m[at, FAST] + 0.005
    others = np.delete(np.arange(len(base.names)), FAST)
    for one in (left, ahead):
        np.testing.assert_array_equal(
            one.agents[1, others], base.agents[1, others]
        )  # before they have seen it
