from __future__ import annotations

import pytest

from service.fleet.policy import Policy
from tests.service.fleet.world import ALGORITHMS, World, reference


@pytest.mark.parametrize("method", ALGORITHMS)
@pytest.mark.parametrize("workers", [1, 4])
def test_bits(method, workers):
    world = World({"j": method})
    for i in range(workers):
        world.join(f"w{i}", 2)
    world.finish()
    assert world.record.statuses == {"j": "done"}
    assert world.bits("j") == reference(method)
    assert world.counted_once("j")


@pytest.mark.parametrize("method", ALGORITHMS)
def test_wrong(method):
    world = World({"j": method}, Policy(first_rows=7, audit_share=1.0))
    world.join("bad", 1, wrong=True)
    for i in range(3):
        world.join(f"w{i}", 2)
    world.finish()
    assert list(world.record.quarantined) == ["bad"]
    assert world.bits("j") == reference(method)
    assert world.counted_once("j")
