"""Contact geometry, on contacts made by hand: which vehicle, which side, which part; a mirror swaps left and right."""

from __future__ import annotations

import math

import numpy as np
import pytest

from service.world import agents as A
from service.world.safety.contact import Contact, contact_of
from service.world.safety.contact_numbers import NUMBERS, contact_from, numbers_of

EGO = (0.0, 0.0, 0.0, 20.0)
# the other vehicle, the ego's side and part, the other's, and who ran into whom
CASES = {
    "runs into one ahead": ((4.3, 0.0, 0.0, 15.0), ("front", "middle"), ("rear", "middle"), "ego"),
    "runs into one ahead with its left half": (
        (4.3, 1.2, 0.0, 15.0), ("front", "left"), ("rear", "right"), "ego",
    ),
    "is run into from behind": ((-4.3, -1.0, 0.0, 28.0), ("rear", "right"), ("front", "left"), "other"),
    "side swipe by one that drifts in": (
        (0.0, 2.05, -0.12, 20.0), ("left", "front"), ("right", "front"), "other",
    ),
    "side swipe from behind": ((-3.0, 1.75, -0.02, 24.0), ("left", "rear"), ("right", "front"), "other"),
    "crossing from the right": ((1.5, -2.9, math.pi / 2, 12.0), ("right", "front"), ("front", "middle"), "other"),
    "head on, itself the faster": ((4.2, 0.0, math.pi, 15.0), ("front", "middle"), ("front", "middle"), "ego"),
    "stood in each other": ((0.2, 1.7, 0.0, 20.0), ("left", "middle"), ("right", "middle"), "other"),
}  # fmt: skip
MIRRORED = {"left": "right", "right": "left"}


def told(contact: Contact | None) -> tuple[tuple[str, str], tuple[str, str]]:
    assert contact is not None
    return (contact.ego_side, contact.ego_part), (contact.other_side, contact.other_part)


@pytest.mark.parametrize("case", CASES)
def test_sides_and_parts_of_a_contact_and_of_its_mirror_image(agents_of, case):
    row, ego, other, striking = CASES[case]
    agents = agents_of(EGO, (200.0, 0.0, 0.0, 0.0), row)
    found = contact_of(agents, 3, 0)
    assert told(found) == (ego, other)
    assert found is not None
    assert found.other == 2
    assert found.speed_mps == pytest.approx(np.hypot(20.0 - row[3] * np.cos(row[2]), row[3] * np.sin(row[2])))
    assert (found.ahead_mps, found.left_mps) == pytest.approx(
        (row[3] * math.cos(row[2]) - 20.0, row[3] * math.sin(row[2])), abs=1e-12
    )
    assert found.striking == striking
    assert contact_from(numbers_of(found)) == found
    agents[:, [A.Y_M, A.HEADING_RAD, A.SIN]] *= -1.0
    swapped = tuple(tuple(MIRRORED.get(word, word) for word in pair) for pair in (ego, other))
    mirrored = contact_of(agents, 3, 0)
    assert told(mirrored) == swapped
    assert mirrored is not None
    assert (mirrored.left_mps, mirrored.striking) == (pytest.approx(-found.left_mps, abs=1e-12), striking)


@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize("drift", [0.02, -0.02])
def test_of_two_sides_the_one_that_moves_across_runs_into_the_other(agents_of, side, drift):
    """The ego drifts to the left, the other keeps straight; then the other way round."""
    agents = agents_of((0.0, 0.0, drift, 20.0), (0.5, side * 1.79, 0.0, 20.0))
    agents[0, A.LANE_HEADING_RAD] = drift
    assert contact_of(agents, 2, 0).striking == ("ego" if drift * side > 0.0 else "other")


def test_without_a_contact_there_is_none_and_of_several_the_fastest_is_told(agents_of):
    assert contact_of(agents_of(EGO, (4.6, 0.0, 0.0, 15.0)), 2, 0) is None
    agents = agents_of(EGO, (4.4, 0.0, 0.0, 15.0), (-4.4, 0.0, 0.0, 29.0))
    found = contact_of(agents, 3, 0)
    assert found is not None
    assert (found.other, found.ego_side) == (2, "rear")


def test_no_contact_is_a_row_of_nothing_and_a_row_that_is_none_is_refused():
    assert contact_from(numbers_of(None)) is None
    wrong = numbers_of(Contact(1, 2.0, -2.0, 0.0, "front", "middle", "rear", "middle", "ego"))
    assert wrong.shape == (NUMBERS,)
    for place, value in ((4, 9.0), (0, -1.0), (8, -1.0)):
        with pytest.raises((ValueError, IndexError)):
            contact_from(np.where(np.arange(NUMBERS) == place, value, wrong))
