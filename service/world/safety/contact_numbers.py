"""A contact as a row of numbers, for arrays of many rollouts; no contact is a row of NaN."""

import math
from typing import get_args

import numpy as np

from service.world.safety.contact import Contact, Part, Side, Who

NUMBERS = 9
SIDES: tuple[Side, ...] = get_args(Side)
PARTS: tuple[Part, ...] = get_args(Part)
WHO: tuple[Who, ...] = get_args(Who)


def numbers_of(contact: Contact | None) -> np.ndarray:
    """(NUMBERS,) float64: the fields in their order, words by their place among those that there are."""
    if contact is None:
        return np.full(NUMBERS, math.nan)
    return np.array(
        [
            contact.other,
            contact.speed_mps,
            contact.ahead_mps,
            contact.left_mps,
            SIDES.index(contact.ego_side),
            PARTS.index(contact.ego_part),
            SIDES.index(contact.other_side),
            PARTS.index(contact.other_part),
            WHO.index(contact.striking),
        ],
        dtype=np.float64,
    )


def contact_from(numbers: np.ndarray) -> Contact | None:
    """The contact of such a row (NUMBERS,), the same to the bit; ValueError or IndexError for a row that is none."""
    if math.isnan(numbers[0]):
        return None
    other, speed, ahead, left, *words = numbers.tolist()
    places = [int(word) for word in words]
    if min(other, *places) < 0:
        raise ValueError(f"no contact: {numbers.tolist()}")
    return Contact(
        int(other),
        speed,
        ahead,
        left,
        SIDES[places[0]],
        PARTS[places[1]],
        SIDES[places[2]],
        PARTS[places[3]],
        WHO[places[4]],
    )
