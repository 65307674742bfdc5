"""Formulas mean what they say: how they are read, their values at a rollout's end, and what rtamt makes of them."""

from __future__ import annotations

import inspect
import sys

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import ce
from service.errors import InputError
from service.evaluation.job import Problem, make_job
from service.world.safety.formula import SIGNALS
from service.world.safety.formula_language import Program, read_formula
from service.world.safety.measure import with_measure
from service.world.safety.robustness import FAR, robustness
from service.world.scenario import load_scenario

A = np.array([5.0, 3.0, 4.0, 7.0])
B = np.array([1.0, 2.0, 10.0, 6.0])
C = np.array([2.0, 8.0, -1.0, 0.5])


def program(formula: str) -> Program:
    return read_formula(formula, ("a", "b", "c"), 100, 10_000)


def value(formula: str, **signals: np.ndarray) -> np.ndarray:
    return robustness(program(formula), signals or {"a": A, "b": B, "c": C})


READ = {
    "a - b + c": A - B + C,
    "a - b - c": A - B - C,
    "a - b * c": A - B * C,
    "2 * a - b": 2 * A - B,
    "a - 2 * b >= 0": A - 2 * B,
    "-a + b": B - A,
    "a - -b": A + B,
    "a * -.5": -A / 2,
    "always(a) - b": np.array([3.0, 3.0, 4.0, 7.0]) - B,
    "always a - b > 0": np.array([-6.0, -6.0, -6.0, 1.0]),
    "not a > b": B - A,
    "a or b and c": np.maximum(A, np.minimum(B, C)),
    "a and b or c": np.maximum(np.minimum(A, B), C),
    "a > 1 implies b > 1 implies c > 1": np.maximum(1 - A, np.maximum(1 - B, C - 1)),
    "a -> c": np.maximum(-A, C),
    "abs(c) + sqrt(a * a)": np.abs(C) + A,
    "a until b and c": np.minimum(np.array([3.0, 3.0, 10.0, 6.0]), C),
    "a + 0 * b": A,
}


@pytest.mark.parametrize("formula", READ)
def test_formulas_are_read_as_they_are_written(formula):
    assert value(formula).tolist() == READ[formula].tolist()


def test_a_difference_and_a_sum_are_read_from_the_left_in_a_rollout():
    """rtamt 0.4.10 reads a - (b + c), by which this rollout of I-80 comes to -38.545."""
    scenario = with_measure(load_scenario("i80-paper-10s"), "stl: always(clearance_m - speed_mps + 20 >= 0)")
    problem = Problem(make_job(scenario, "idm", 0.0, "naive", 1, {}))
    x, noise_seeds = ce.draw(problem.base, 1, "estimate", 0, 0, 1)
    with problem.simulator() as simulator:
        found = simulator.run(x[0], int(noise_seeds[0]))
    assert (found.error, round(found.f, 3)) == (None, 1.455)


def test_infinite_tails_of_short_rollouts_do_not_come_through():
    """A rollout that ends before an interval does: windows are cut at its end (rtamt 0.4.10 gives inf, or fails)."""
    speed = np.array([20.0 - 0.1 * k for k in range(16)] + [29.0])
    cases = {
        "eventually[0:2 s](a) and always(a)": 18.5,
        "always[0:2 s](a) or eventually(a)": 29.0,
        "always[0:2 s](a) and eventually[0:0.5 s](a >= 0)": 18.5,
    }
    for formula, expected in cases.items():
        assert value(formula, a=speed)[0] == expected, formula
        assert np.isfinite(value(formula, a=speed)).all()


def test_beyond_the_end_nothing_is_demanded_and_nothing_happens():
    assert value("always[1:2 s](a)").tolist() == [FAR] * 4
    assert value("eventually[1:2 s](a)").tolist() == [-FAR] * 4
    assert value("a until[1:2 s] b").tolist() == [-FAR] * 4
    assert value("historically[0.2:0.3 s](a)").tolist() == [FAR, FAR, 5.0, 3.0]
    assert value("once[0.2:0.3 s](a)").tolist() == [-FAR, -FAR, 5.0, 5.0]
    assert value("a since[0.2:0.3 s] b").tolist() == [-FAR, -FAR, 1.0, 2.0]


def test_values_beyond_the_largest_signal_are_kept():
    assert value("always[0:1 s](a * 1000)")[0] == 3000.0
    assert value("eventually[0:1 s](a * -1000)")[0] == -3000.0
    assert value("(a * 1000) until[0:1 s] (b * -1000)")[0] == -1000.0


def test_a_value_that_is_no_number_is_an_error():
    with pytest.raises(InputError, match="root of -1"):
        value("sqrt(c) > 1")
    with pytest.raises(InputError, match="products are too large"):
        value("a" + " * 1e300" * 3 + " > b")


def test_a_text_of_any_shape_needs_no_deep_stack():
    """2,000 characters of any operator are read and worked out within a shallow stack."""
    limit = sys.getrecursionlimit()
    sys.setrecursionlimit(150 + len(inspect.stack()))
    try:
        assert value("not " * 490 + "a")[0] == 5.0
        assert value(" -> ".join(["a"] * 300))[0] == 5.0
        assert value(" - ".join(["a"] * 400))[0] == 5.0 - 399 * 5.0
        assert value("-" * 1_000 + "a")[0] == 5.0
    finally:
        sys.setrecursionlimit(limit)


leaves = st.sampled_from(["a", "b", "(a >= 1.5)", "(b < 0.5)", "(a - b)", "(2.0 * b + a)"])


def windows() -> st.SearchStrategy[str]:
    return st.just("") | st.tuples(st.integers(0, 6), st.integers(0, 6)).map(
        lambda w: f"[{w[0] * 100} ms:{(w[0] + w[1]) * 100} ms]"
    )


def grown(inner: st.SearchStrategy[str]) -> st.SearchStrategy[str]:
    unary = st.tuples(st.sampled_from(["always", "eventually", "historically", "once"]), windows(), inner)
    binary = st.tuples(inner, st.sampled_from(["and", "or", "implies"]), inner)
    timed = st.tuples(inner, st.sampled_from(["until", "since"]), windows(), inner)
    return (
        unary.map(lambda f: f"({f[0]}{f[1]}({f[2]}))")
        | binary.map(lambda f: f"(({f[0]}) {f[1]} ({f[2]}))")
        | timed.map(lambda f: f"(({f[0]}) {f[1]}{f[2]} ({f[3]}))")
        | inner.map(lambda f: f"(not({f}))")
    )


@settings(max_examples=150, deadline=None)
@given(
    st.recursive(leaves, grown, max_leaves=5),
    st.lists(st.tuples(st.integers(-50, 50), st.integers(-50, 50)), min_size=30, max_size=45),
)
def test_rtamt_is_of_the_same_opinion(formula, states):
    """Where every operator stands in brackets and the rollout is longer than any window: rtamt 0.4.10 reads sums from
    the right, and lengthens the lists that it is given by infinities where a window is longer than the rollout.
    """
    rtamt = pytest.importorskip("rtamt", reason="rtamt runs on Python 3.11 and 3.12 only")
    a, b = (np.array(column) / 4.0 for column in zip(*states, strict=True))
    formula = f"({formula}) and ((a - b) >= -500.0)"
    specification = rtamt.StlDiscreteTimeOfflineSpecification()
    specification.declare_var("a", "float")
    specification.declare_var("b", "float")
    specification.set_sampling_period(100, "ms", 0.1)
    specification.spec = formula
    specification.parse()
    theirs = specification.evaluate({"time": list(range(len(a))), "a": a.tolist(), "b": b.tolist()})
    ours = value(formula, a=a, b=b)[0]
    if np.isfinite(theirs[0][1]):
        assert ours == theirs[0][1]
    else:
        assert abs(ours) == FAR
        assert ours * theirs[0][1] > 0


def test_every_signal_may_stand_behind_any_operator():
    """`speed_mps - 2 * lane_offset_m >= 0` is a formula like any other."""
    for name in SIGNALS:
        read = read_formula(
            f"always({name} - 2 * {name} >= 0 and 2 * {name} + 1 > -{name})", SIGNALS, 100, 10_000
        )
        assert read.signals == (name,)
