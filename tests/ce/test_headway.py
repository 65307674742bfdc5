"""How far a proposal is ahead of the base at a level."""

import math

import numpy as np
import pytest
from scipy.special import ndtr

from ce.headway import headway


def test_the_base_is_not_ahead_of_itself():
    u = np.random.default_rng(1).standard_normal(4000)
    assert headway(-u, np.zeros(u.size), -2.0) == pytest.approx(0.0, abs=1e-12)


def test_a_shifted_proposal_is_ahead_by_what_its_weights_say():
    """E[w; event]^2 / E[w^2; event] over P(event) for N(b, 1) in place of N(0, 1) and the event u >= b, exactly."""
    b = 3.0
    u = b + np.random.default_rng(2).standard_normal(200_000)
    p, second = ndtr(-b), math.exp(b * b) * ndtr(-2 * b)
    exact = math.log(p / second) / -math.log(p)
    assert 0.5 < exact < 1.0
    assert headway(-u, b * b / 2 - b * u, -b) == pytest.approx(exact, abs=0.01)


@pytest.mark.parametrize("level", [math.inf, 0.5, -9.0], ids=["no level yet", "common", "nothing below it"])
def test_a_level_that_tells_nothing_is_no_number(level: float):
    u = np.random.default_rng(3).standard_normal(1000)
    assert math.isnan(headway(-u, np.zeros(u.size), level))
