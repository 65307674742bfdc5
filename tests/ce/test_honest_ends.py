"""Intervals at the edges: nothing found, all events, hardly any budget; and input that is not what it seems."""

import numpy as np
import pytest

import ce

BASE = ce.Product([ce.Normal(np.zeros(2), np.eye(2))])


def hidden(x):
    """Some 1e-5: a small disc that no level leads to."""
    return np.where((x[:, 0] - 2.6) ** 2 + (x[:, 1] + 2.6) ** 2 < 0.01, -1.0, np.exp(-x[:, 0] - x[:, 1]))


@pytest.mark.parametrize("seed", range(4))
def test_splitting_without_an_event_claims_no_more_than_counting_would(seed):
    est = ce.estimate(hidden, BASE, 0.0, "splitting", budget=5000, seed=seed)
    assert est.events == 0
    assert est.ci[1] >= 1.0 - 0.025 ** (1.0 / est.rollouts)
    named = {w.name: w.message for w in est.warnings}
    assert f"naive Monte Carlo with {est.rollouts} rollouts" in named["no-events"]


@pytest.mark.parametrize("method", ce.METHODS)
@pytest.mark.parametrize("budget", [1, 5, 100, 1000, 2000])
@pytest.mark.parametrize(
    "f",
    [
        lambda x: -1.0 - 0.0 * x[:, 0],
        lambda x: np.where(x[:, 0] > 3.5, 1.0, -1.0),
        lambda x: 1.0 + x[:, 0] ** 2,
    ],
)
def test_no_interval_has_zero_width(method, budget, f):
    try:
        est = ce.estimate(f, BASE, 0.0, method, budget=budget)
    except ce.BudgetError:
        return  # too few for the method: said by name
    low, high = est.ci
    assert low < high
    assert low <= est.p <= high


@pytest.mark.parametrize("method", ce.METHODS)
def test_a_budget_is_an_integer_of_a_size_that_ends(method):
    with pytest.raises(ce.OptionsError, match="write 20000"):
        ce.OPTIONS[method](budget=2e4)
    with pytest.raises(ce.BudgetError, match="at most"):
        ce.OPTIONS[method](budget=10**30)


@pytest.mark.parametrize(
    ("answer", "said"),
    [
        (lambda x: np.ma.array(x[:, 0], mask=x[:, 0] > 0), "masked"),
        (lambda x: x[:, 0] + 1j, "real numbers"),
        (lambda x: x[:, 0].astype(str), "real numbers"),
    ],
)
def test_what_is_no_plain_number_is_refused(answer, said):
    with pytest.raises(ce.ResponseError, match=said):
        ce.estimate(answer, BASE, 0.0, "naive", budget=100)


def test_text_is_no_threshold():
    with pytest.raises(ce.ThresholdError):
        ce.estimate(hidden, BASE, "0.5")
