import math

import numpy as np
import pytest

import ce
from tests.reference.problems import LINEAR_2


def tail(beta):
    return 0.5 * math.erfc(beta / math.sqrt(2))


@pytest.fixture(scope="module")
def found():
    algorithm = ce.algorithm("mixture", LINEAR_2.base, 0.0, ce.MixtureOptions(budget=20_000))
    state, events = algorithm.init(0), []
    while (batch := algorithm.propose(state)) is not None:
        f = LINEAR_2.f(batch.x)
        if batch.phase == "estimate":
            events.append(batch.x[f <= 0.0])
        state, _ = algorithm.update(state, batch, f)
    return algorithm.estimate(state), np.concatenate(events)


def test_another_base_from_the_same_rollouts(found):
    est, x = found
    moved = LINEAR_2.base.with_parameters([0.2, 0.1])
    again = ce.reweighted(est, LINEAR_2.base, moved, x)
    assert again.p == pytest.approx(tail(3.5 - 0.3 / math.sqrt(2)), abs=4 * again.std_error)
    assert again.std_error < 0.05 * again.p


def test_a_base_that_the_rollouts_do_not_carry_is_refused(found):
    est, x = found
    with pytest.raises(ce.OptionsError, match="do not carry"):
        ce.reweighted(est, LINEAR_2.base, LINEAR_2.base.with_parameters([6.0, -6.0]), x)
    with pytest.raises(ce.ResponseError):
        ce.reweighted(est, LINEAR_2.base, LINEAR_2.base, x[:-1])


def test_slope_in_the_base_parameters(found):
    est, x = found
    slope = ce.sensitivity(est, LINEAR_2.base, x)
    exact = math.exp(-0.5 * 3.5**2) / math.sqrt(2 * math.pi) / math.sqrt(2)
    assert np.all(np.abs(slope.derivative - exact) < 4 * slope.std_error)
    assert np.all((slope.low < slope.derivative) & (slope.derivative < slope.high))


@pytest.mark.parametrize(("p", "radius"), [(1e-4, 0.01), (1e-6, 1e-6), (0.3, 0.1)])
def test_worst_case_is_on_the_ball(p, radius):
    q = ce.worst_case(p, radius)
    assert q > p
    assert q * math.log(q / p) + (1 - q) * math.log1p(-q) - (1 - q) * math.log1p(-p) == pytest.approx(
        radius, rel=1e-6
    )


def test_worst_case_at_its_ends():
    assert ce.worst_case(1e-3, 0.0) == 1e-3
    assert ce.worst_case(1e-3, 10.0) == 1.0
    with pytest.raises(ce.OptionsError):
        ce.worst_case(1e-3, -1.0)
