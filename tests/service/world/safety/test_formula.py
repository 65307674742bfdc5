"""Signal temporal logic formulas: robustness by hand and by the textbook's recursion, and what is not let in."""

from __future__ import annotations

import math
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from service.errors import InputError
from service.world import agents as A
from service.world.safety.formula import FAR, SIGNALS, FormulaMonitor, checked_formula

STEP_MS, HORIZON_MS = 100, 10_000


@pytest.fixture(scope="session")
def robustness(make_scenario, agents_of):
    """robustness(formula, ttc_s=[...], speed_mps=[...]): the trace of a rollout with these signals."""
    scenario = make_scenario()

    def run(formula: str, **signals: list[float]) -> np.ndarray:
        monitor = FormulaMonitor(formula, scenario)
        monitor.reset()
        states = len(next(iter(signals.values())))
        for k in range(states):
            agents = agents_of((0.0, 0.0, 0.0, signals.get("speed_mps", [0.0] * states)[k]))
            agents[0, A.ACCELERATION_MPS2] = signals.get("acceleration_mps2", [0.0] * states)[k]
            monitor.see(agents, 1, signals.get("ttc_s", [math.inf] * states)[k])
        return monitor.trace()

    return run


def test_always_is_the_smallest_margin(robustness):
    trace = robustness("always(ttc_s >= 1.5)", ttc_s=[3.0, 1.0, 2.0, 4.0])
    assert trace.tolist() == [-0.5, -0.5, 0.5, 2.5]


def test_eventually_within_an_interval_looks_that_far_and_no_further(robustness):
    trace = robustness("eventually[0:200 ms](speed_mps >= 10)", speed_mps=[1.0, 2.0, 3.0, 12.0, 5.0])
    assert trace.tolist() == [-7.0, 2.0, 2.0, 2.0, -5.0]
    assert robustness("eventually[0.1:0.2](speed_mps >= 10)", speed_mps=[12.0, 1.0, 3.0, 2.0])[0] == -7.0


def test_a_response_has_to_come_in_time(robustness):
    formula = "always(ttc_s < 2 implies eventually[0:0.2 s](acceleration_mps2 <= -2))"
    ttc = [5.0, 1.0, 1.5, 5.0, 5.0, 5.0]
    assert robustness(formula, ttc_s=ttc, acceleration_mps2=[0.0, 0.0, -3.0, 0.0, 0.0, 0.0])[0] == 1.0
    assert robustness(formula, ttc_s=ttc, acceleration_mps2=[0.0, 0.0, 0.0, 0.0, -3.0, 0.0])[0] == -1.0


def test_until_holds_the_left_side_up_to_the_right_one(robustness):
    trace = robustness("(speed_mps >= 5) until (ttc_s < 1)", speed_mps=[7.0, 6.0, 9.0], ttc_s=[4.0, 3.0, 0.5])
    assert trace[0] == 0.5


def test_signals_that_are_infinite_count_as_far(robustness):
    assert robustness("always(ttc_s >= 1.5)", ttc_s=[math.inf, math.inf])[0] == FAR - 1.5
    assert robustness("always(ttc_s - ttc_s >= 0)", ttc_s=[math.inf, math.inf])[0] == 0.0


def test_the_same_monitor_gives_the_same_value_for_the_next_rollout(make_scenario, agents_of):
    monitor = FormulaMonitor(
        "always(historically[0:1 s](ttc_s >= 1) or once(speed_mps > 3))", make_scenario()
    )
    values = []
    for ttc in (0.5, 3.0, 0.5):
        monitor.reset()
        for k in range(12):
            monitor.see(agents_of((0.0, 0.0, 0.0, 0.1 * k)), 1, ttc)
        values.append(monitor.value())
    assert values[0] == values[2] != values[1]


numbers = st.lists(st.floats(-5.0, 5.0), min_size=3, max_size=15)


@settings(max_examples=60, deadline=None)
@given(numbers, st.integers(0, 5), st.integers(0, 5), st.booleans())
def test_nested_operators_are_those_of_the_textbook(robustness, speeds, low, more, first_always):
    """Maler and Nickovic (2004): min over the window for always, max for eventually, windows cut at the end."""
    n, high = len(speeds), low + more
    outer, inner = (min, max) if first_always else (max, min)
    pad = FAR if outer is min else -FAR
    expected = []
    for k in range(n):
        inside = [inner(speeds[i : i + 3], default=0.0) - 1.0 for i in range(n)]
        expected.append(outer(inside[k + low : k + high + 1], default=pad))
    words = ("always", "eventually") if first_always else ("eventually", "always")
    formula = f"{words[0]}[{low * 100}:{high * 100} ms]({words[1]}[0:0.2 s](speed_mps >= 1))"
    assert robustness(formula, speed_mps=speeds).tolist() == pytest.approx(expected)


REFUSED = {
    "from os import path always(ttc_s>1)": "no signal 'from'",
    "always(ttc > 1)": r"no signal 'ttc'; did you mean 'ttc_s'\?",
    "always(exp(ttc_s) > 1)": "no signal 'exp'",
    "always(ttc_s / speed_mps > 1)": "'/' is not part of the language",
    "@ros(topic)": "'@' is not part of the language",
    "out = always(ttc_s > 1)": "no signal 'out'",
    "always[0:1000 s](ttc_s > 1)": "up to the horizon of 10000 ms",
    "always[0:50 ms](ttc_s > 1)": "whole steps of 100 ms",
    "always[2:1](ttc_s > 1)": "must go forward",
    "not[0:1](ttc_s > 1)": "an interval follows one of always",
    "always[0:x](ttc_s > 1)": r"'\[' is not part of the language",
    "1 > 2": "it has no signal",
    "(" * 60 + "ttc_s > 1" + ")" * 60: "more than 40 brackets",
    "ttc_s > 1 or " * 300 + "ttc_s > 1": "at most 2000 are taken",
    "always(ttc_s >": "ends where a signal, a number or a bracket is due",
    "always(ttc_s > 1": "1 bracket is not closed",
    "always(ttc_s > 1))": r"'\)' closes no bracket",
    "ttc_s ttc_s": "an operator is due, not 'ttc_s'",
    "ttc_s > > 1": "a signal, a number or a bracket is due, not '>'",
    "ttc_s > 1 always(ttc_s > 2)": "an operator is due, not 'always'",
    "always[0:1][0:1](ttc_s > 2)": "an interval follows one of always",
    "1 < ttc_s < 2": "join comparisons by 'and'",
    "ttc_s > 1 until ttc_s > 2 until ttc_s > 3": "a bracket around one of the two, 'until' or 'since'",
    "not (ttc_s) > 1": r"it could mean \(not \(...\)\) > ... or not \(\(...\) > ...\)",
    "ttc_s - always speed_mps > 1": "put a bracket around what 'always' is said of",
    "abs lane_offset_m > 1": r"abs takes a bracket, as in abs\(lane_offset_m\)",
    "ttc_s > 1e999": "the number 1e999 is too large",
}


@pytest.mark.parametrize("formula", REFUSED, ids=lambda formula: formula[:30])
def test_a_bad_formula_is_refused_with_what_is_wrong(make_scenario, formula):
    with pytest.raises(InputError, match=REFUSED[formula]):
        FormulaMonitor(formula, make_scenario())


@settings(max_examples=300, deadline=None)
@given(
    st.text(max_size=60)
    | st.lists(st.sampled_from([*SIGNALS, "always", "[0:1]", "(", ")", ">", "1.5", "until", "-"])).map(
        " ".join
    )
)
def test_any_text_is_taken_or_refused_and_nothing_else(make_scenario, text):
    try:
        FormulaMonitor(text, make_scenario())
    except InputError:
        return
    assert checked_formula(text, STEP_MS, HORIZON_MS).signals


def test_nothing_is_imported_by_a_formula(tmp_path):
    (tmp_path / "planted.py").write_text("open('imported', 'w').close()\n", encoding="utf-8")
    code = (
        "from service.world.safety.measure import with_measure\nfrom service.world.scenario import load_scenario\n"
        "from service.errors import InputError\n"
        "try:\n    with_measure(load_scenario('i80-paper-10s'), 'stl: from planted import path\\nalways(ttc_s > 1)')\n"
        "except InputError as error:\n    print('refused:', error)\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", code],
        cwd=tmp_path,
        env={"PYTHONPATH": f"{Path(__file__).parents[4]}:{tmp_path}", "PATH": "", "HOME": str(tmp_path)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert "refused:" in done.stdout, done.stderr
    assert not (tmp_path / "imported").exists()
