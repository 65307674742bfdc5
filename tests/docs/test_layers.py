"""The import contracts: what a room holds stands in the room's order, so that nothing new is left free of it."""

from __future__ import annotations

import pytest

from docs.site.architecture import BELOW, Room, rooms
from docs.site.gather import ROOT

INSIDE = [room for room in rooms() if room.inside]


def test_the_rooms_that_have_an_order_are_those_of_the_service():
    names = {room.module for room in rooms()} - {"tailroad", "service.training", *BELOW}
    assert {room.module for room in INSIDE} == names


@pytest.mark.parametrize("room", INSIDE, ids=[room.module for room in INSIDE])
def test_everything_in_a_room_stands_in_its_order(room: Room):
    listed = {name.strip() for layer in room.inside for name in layer.replace(":", "|").split("|")}
    folder = ROOT / room.module.replace(".", "/")
    sources = {path.stem for path in folder.glob("*.py")} - {"__init__", "__main__"}
    assert listed == sources | {path.parent.name for path in folder.glob("*/__init__.py")}
