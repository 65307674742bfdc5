"""Logarithmic efficiency of a proposal at a level, and what follows from it."""

import math

import numpy as np
import pytest
from scipy.special import ndtr

from ce.log_efficiency import log_efficiency, stalled, well_ahead


def test_the_base_is_not_ahead_of_itself():
    u = np.random.default_rng(1).standard_normal(4000)
    assert log_efficiency(-u, np.zeros(u.size), -2.0) == pytest.approx(0.0, abs=1e-12)


def test_a_shifted_proposal_is_ahead_by_what_its_weights_say():
    """E[w; event]^2 / E[w^2; event] over P(event) for N(b, 1) in place of N(0, 1) and the event u >= b, exactly."""
    b = 3.0
    u = b + np.random.default_rng(2).standard_normal(200_000)
    p, second = ndtr(-b), math.exp(b * b) * ndtr(-2 * b)
    exact = math.log(p / second) / -math.log(p)
    assert 0.5 < exact < 1.0
    assert log_efficiency(-u, b * b / 2 - b * u, -b) == pytest.approx(exact, abs=0.01)


@pytest.mark.parametrize("level", [math.inf, 0.5, -9.0], ids=["no level yet", "common", "nothing below it"])
def test_a_level_that_tells_nothing_is_no_number(level: float):
    u = np.random.default_rng(3).standard_normal(1000)
    assert math.isnan(log_efficiency(-u, np.zeros(u.size), level))


NAN = math.nan


@pytest.mark.parametrize(
    ("efficiencies", "spent", "since_mode_search", "left"),
    [
        ((NAN, 0.2, 0.25), 0.3, None, True),
        ((NAN, 0.2, 0.25), 0.15, None, False),
        ((NAN, 0.2, 0.35), 0.3, None, False),
        ((NAN, 0.2, 0.45), 0.3, None, False),
        ((NAN, 0.5, 0.1), 0.3, None, False),
        ((NAN, NAN, 0.2), 0.3, None, False),
        ((0.1, NAN), 0.3, None, False),
        ((0.2,), 0.3, None, False),
        ((NAN, 0.2, 0.25), 0.3, 0, False),
        ((0.2, 0.25, 0.25), 0.3, 1, True),
        ((0.2, 0.25, 0.35), 0.3, 1, False),
        ((0.7, 0.75, 0.15), 0.3, 1, False),
        ((NAN, NAN, 0.15), 0.3, 1, True),
        ((0.1, NAN), 0.3, 1, False),
        ((0.75, 0.2, 0.25), 0.3, 2, True),
    ],
    ids=[
        "hardly ahead", "early", "rising", "ahead", "one poor batch after a good one",
        "nothing before", "a level that tells nothing", "one batch", "the mode search is awaited",
        "not helped by the mode search", "helped by it", "well ahead before the mode search",
        "nothing before the mode search", "after the mode search, nothing", "the batch after",
    ],
)  # fmt: skip
def test_when_a_search_is_held_to_have_stalled(
    efficiencies: tuple[float, ...], spent: float, since_mode_search: int | None, left: bool
):
    assert stalled(efficiencies, spent, since_mode_search) is left


@pytest.mark.parametrize(
    ("efficiencies", "yes"), [((), False), ((NAN, NAN), False), ((0.2, 0.8, NAN), True), ((0.8, 0.2), False)]
)
def test_a_search_is_well_ahead_where_the_last_batch_that_tells_is(
    efficiencies: tuple[float, ...], yes: bool
):
    assert well_ahead(efficiencies) is yes
