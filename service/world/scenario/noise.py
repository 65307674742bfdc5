"""A scenario with another kind of action noise."""

from typing import Literal

import msgspec

from service.world.scenario.check import check_values
from service.world.scenario.schema import Scenario

Noise = Literal["drawn", "frozen", "searched"]


def with_noise(scenario: Scenario, noise: Noise | None, source: str = "") -> Scenario:
    """The scenario with that action noise; None leaves it. ScenarioError where it cannot have it."""
    if noise is None:
        return scenario
    drivers = msgspec.structs.replace(scenario.drivers, noise=noise)
    changed = msgspec.structs.replace(scenario, drivers=drivers)
    check_values(changed, source or scenario.name)
    return changed
