"""What the other driver did wrong, from states of mind made by hand, and the sentence that tells it."""

from __future__ import annotations

import msgspec
import numpy as np
import pytest

import ce
from policies.drivers import load_drivers
from service.analysis.failures.lapses import Lapse, lapse_of, sentence
from service.analysis.trace import Trace
from service.world.safety.contact import Contact
from service.world.scenario import load_scenario
from service.world.scenario.base import base_distribution
from service.world.sim import minds as M
from service.world.sim.rollout import Rollout
from tests.service.analysis.failures.test_modes import REAR_END

OTHER = 3  # env4
SCENARIO = load_scenario("i80-10s")


@pytest.fixture(scope="module")
def base() -> ce.Product:
    return base_distribution(SCENARIO, load_drivers(SCENARIO.drivers.weights))


def trace_of(away: list[tuple[float, float]], seconds: float, leaks: bool = False) -> Trace:
    """A driver who looks away from each first time to each second, to the state at `seconds`; the kernel's columns."""
    states = round(seconds / 0.1) + 1
    minds = np.zeros((states, 6, M.COLUMNS))
    minds[0, :, M.SINCE_AWAY_S] = M.NEVER_S
    for k in range(1, states):
        minds[k] = minds[k - 1]
        mine = minds[k, OTHER]
        now = [g for g in away if round(g[0] / 0.1) <= k - 1 < round(g[1] / 0.1)]
        if now:
            mine[M.LEAKED] += leaks and k - 1 == round(now[0][0] / 0.1)
            mine[M.AWAY_S] = max(now[0][1] - 0.1 * k, 0.0)
            mine[M.LONGEST_AWAY_S] = now[0][1] - now[0][0]
            mine[M.SINCE_AWAY_S] = 0.0
        else:
            mine[M.AWAY_S] = 0.0
            mine[M.SINCE_AWAY_S] += 0.1
    nothing = np.zeros(states)
    names = tuple(v.name for v in SCENARIO.vehicles)
    return Trace(names, 0, 0.1 * np.arange(states), np.zeros((states, 6, 26)), nothing, np.zeros((states - 1, 2)), 1.0,
                 Rollout(0.0, "horizon", states - 1), "ttc-impact", nothing, minds)  # fmt: skip


def draw(base: ce.Product, **named: float) -> np.ndarray:
    x = np.zeros(base.dim)
    x[base.names.index("env4.glance_onset_s")] = 50.0
    for name, value in named.items():
        x[base.names.index(f"env4.{name}")] = value
    return x


def lapse_at(base: ce.Product, away: list[tuple[float, float]], leaks: bool = False, **named: float) -> Lapse:
    trace = trace_of(away, 5.0, leaks)
    motion = msgspec.structs.replace(REAR_END, other=OTHER, time_s=5.0)
    found = lapse_of(trace, motion, SCENARIO, draw(base, **named))
    assert found is not None
    return found


def test_a_glance_under_way_counts_until_the_moment(base):
    found = lapse_at(base, [(3.1, 6.0)], glance_onset_s=3.13, glance_duration_s=2.9, reaction_s=0.8)
    assert found.away_s == pytest.approx(1.9)
    assert found.ago_s == 0.0
    assert (found.kind, found.named, found.in_conflict) == ("looked-away", True, False)
    assert found.reaction_s == pytest.approx(0.8, abs=1e-5)


def test_a_glance_that_leaked_and_is_over_is_told_where_it_is_recent(base):
    found = lapse_at(base, [(2.0, 4.0)], leaks=True, glance_onset_s=1.0)
    assert (found.away_s, found.ago_s) == (pytest.approx(2.0), pytest.approx(1.0))
    assert (found.kind, found.named) == ("looked-away-in-conflict", False)
    assert lapse_at(base, [(1.0, 3.0)]).kind == "attentive"  # looked up two seconds before
    assert lapse_at(base, [(1.0, 3.0)], reaction_s=1.6).kind == "slow"
    assert lapse_at(base, [(4.6, 4.8)]).kind == "attentive"  # too short to matter
    assert lapse_at(base, []).away_s == 0.0


def test_drivers_without_a_mind_have_no_lapse(base):
    trace = trace_of([], 5.0)
    assert lapse_of(trace, None, SCENARIO, draw(base)) is None
    assert lapse_of(trace, REAR_END, load_scenario("i80-paper-10s"), draw(base)) is None


def test_the_sentence_tells_who_looked_away_what_the_ego_did_and_how_they_closed():
    behind = msgspec.structs.replace(
        REAR_END, ahead_m=-9.0, closing_along_mps=4.0, ego_braking_mps2=2.0, ego_moved_left_m=0.0,
        other_moved_left_m=0.0,
    )  # fmt: skip
    lapse = Lapse(away_s=1.9, ago_s=0.0, in_conflict=False, named=True, reaction_s=0.9)
    assert (
        sentence(behind, lapse, "env4") == "env4 looks away 1.9 s while the ego slows, and closes at 4.0 m/s"
    )
    slow = msgspec.structs.replace(lapse, away_s=0.0, reaction_s=1.8)
    assert sentence(behind, slow, "env4").startswith("env4 takes 1.8 s to react while the ego slows")
    beside = msgspec.structs.replace(
        behind,
        ahead_m=8.0,
        before_left_m=-3.0,
        other_moved_left_m=1.2,
        ego_braking_mps2=0.0,
        ego_speed_mps=17.0,
    )
    told = sentence(beside, lapse, "env4")
    moved = "env4 looks away 1.9 s and comes over by 1.2 m while the ego drives at 17.0 m/s"
    assert told == f"{moved}, and the ego closes at 4.0 m/s"
    struck = Contact(3, 4.2, 4.2, 0.0, "rear", "left", "front", "middle", "other")
    assert sentence(behind, lapse, "env4", struck) == (
        "env4 looks away 1.9 s while the ego slows, and runs into the ego's rear at 4.2 m/s"
    )
    swiped = Contact(3, 0.6, 0.4, -0.4, "right", "front", "left", "rear", "ego")
    assert sentence(beside, None, "env4", swiped).endswith(
        ", and the ego comes into its left side at 0.6 m/s"
    )
    parted = msgspec.structs.replace(beside, closing_along_mps=0.0, closing_across_mps=0.4)
    assert sentence(parted, None, "env4") == (
        "env4 comes over by 1.2 m while the ego drives at 17.0 m/s, and the sides close at 0.4 m/s"
    )
