import numpy as np
import pytest

import ce
from tests.reference.problems import BETAS, LINEAR_2

OPTIONS = ce.CrossEntropyOptions(budget=20_000)


@pytest.fixture(scope="module")
def weighted():
    return ce.estimate(BETAS.f, BETAS.base, BETAS.gamma, "ce", options=OPTIONS)


@pytest.fixture(scope="module")
def naive():
    return ce.estimate(BETAS.f, BETAS.base, 0.45, "naive", budget=20_000)


@pytest.mark.parametrize("kind", ["weighted", "naive"])
def test_curve_at_gamma_is_the_estimate(kind, request):
    est = request.getfixturevalue(kind)
    curve = est.curve([est.gamma])
    assert (curve.p[0], curve.std_error[0]) == (est.p, est.std_error)
    assert (curve.low[0], curve.high[0]) == est.ci


def test_curve_holds_the_exact_probabilities_and_rises(weighted, naive):
    gammas = np.linspace(0.15, 0.3, 16)
    exact = (3 * gammas**2 - 2 * gammas**3) ** 5
    curve = weighted.curve(gammas)
    assert np.all(np.diff(curve.p) >= 0)
    assert np.all(np.abs(curve.p - exact) < 4 * curve.std_error)
    assert np.all((curve.low <= curve.p) & (curve.p <= curve.high))
    wide = np.linspace(0.3, 0.8, 11)
    exact = (3 * wide**2 - 2 * wide**3) ** 5
    found = naive.curve(wide)
    assert np.all(np.abs(found.p - exact) < 4 * np.sqrt(exact * (1 - exact) / 20_000))


@pytest.mark.parametrize("kind", ["weighted", "naive"])
def test_trace_ends_at_the_estimate(kind, request):
    est = request.getfixturevalue(kind)
    trace = est.trace(100)
    assert 50 <= trace.rollouts.size <= 100
    assert np.all(np.diff(trace.rollouts) > 0)
    assert trace.rollouts[-1] == est.estimation_rollouts
    assert trace.p[-1] == pytest.approx(est.p, rel=1e-12)
    assert (trace.low[-1], trace.high[-1]) == pytest.approx(est.ci, rel=1e-9)
    assert np.all((trace.low <= trace.p) & (trace.p <= trace.high))


def test_estimate_does_not_depend_on_the_order_of_the_rollouts(weighted):
    order = np.random.default_rng(0).permutation(weighted.f.size)
    shuffled = ce.Estimate(
        **{**vars_of(weighted), "f": weighted.f[order], "log_weights": weighted.log_weights[order]}
    )
    assert (shuffled.p, shuffled.std_error, shuffled.ci) == (weighted.p, weighted.std_error, weighted.ci)


def vars_of(est):
    return {name: getattr(est, name) for name in est.__dataclass_fields__}


def test_figures_agree_with_their_definitions(weighted):
    w = np.exp(weighted.log_weights) * (weighted.f <= weighted.gamma)
    n = w.size
    assert weighted.p == pytest.approx(w.mean())
    assert weighted.std_error == pytest.approx(w.std(ddof=1) / np.sqrt(n))
    assert weighted.ess == pytest.approx(w.sum() ** 2 / np.sum(w**2))
    assert weighted.max_weight_share == pytest.approx(w.max() / w.sum())
    assert weighted.events == np.count_nonzero(w)
    assert weighted.rollouts == 20_000
    assert weighted.training_rollouts == 8000
    expected = weighted.p * (1 - weighted.p) / 20_000 / weighted.std_error**2
    assert weighted.efficiency == pytest.approx(expected)
    assert ce.variance_ratio(weighted, weighted) == 1


def test_zero_weighted_events_give_an_upper_bound_from_the_base_rollouts(weighted):
    curve = weighted.curve([-1.0])
    assert curve.p[0] == curve.low[0] == 0
    assert curve.high[0] >= 1 - 0.025 ** (1 / 800)


def test_one_line_summary_names_the_warnings():
    est = ce.estimate(LINEAR_2.f, LINEAR_2.base, 0.0, "naive", budget=1000)
    assert str(est).startswith("p = ")
    assert any(w.name in str(est) for w in est.warnings)
