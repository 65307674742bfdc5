"""What a worker says of contacts: read as it was written, and refused where no rollout can come to it."""

from __future__ import annotations

import math

import msgspec
import numpy as np
import pytest

from service.evaluation.pool import OUTCOME_CODES
from service.evaluation.store import Chunk
from service.remote.fleet.answers import COLLISION, answer_of, chunk_of
from service.remote.fleet.messages import Answer, BadMessage, ChunkKey
from service.world.safety.contact import Contact

KEY = ChunkKey("j", "estimate", 0, 0, 3, "d")
TOUCH = Contact(2, 3.0, -3.0, 0.0, "front", "middle", "rear", "left", "ego")


def answer(contacts: dict[int, Contact] | None) -> Answer:
    codes = np.array([0, COLLISION, 1], np.uint8)
    chunk = Chunk(0, 3, np.array([1.0, -3.0, 2.0]), codes, np.ones(3, np.int32), {}, 0.1, contacts=contacts)
    return msgspec.msgpack.decode(msgspec.msgpack.encode(answer_of("w", 1, KEY, chunk)), type=Answer)


def test_contacts_come_over_as_they_are_and_an_older_worker_tells_none():
    assert OUTCOME_CODES["collision"] == COLLISION
    assert chunk_of(answer({1: TOUCH})).contacts == {1: TOUCH}
    assert chunk_of(answer(None)).contacts is None


@pytest.mark.parametrize(
    ("contacts", "says"),
    [
        ({}, "for the rollouts that ended in a collision"),
        ({1: TOUCH, 2: TOUCH}, "and for no others"),
        ({1: msgspec.structs.replace(TOUCH, left_mps=math.nan)}, "no contact is"),
        ({1: msgspec.structs.replace(TOUCH, other=-1)}, "no contact is"),
    ],
)
def test_contacts_that_no_rollout_can_come_to_are_refused(contacts, says):
    with pytest.raises(BadMessage, match=says):
        chunk_of(answer(contacts))


def test_a_side_that_no_vehicle_has_is_refused():
    with pytest.raises(msgspec.ValidationError, match="ego_side"):
        answer({1: msgspec.structs.replace(TOUCH, ego_side="roof")})
