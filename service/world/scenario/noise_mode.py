"""A scenario with another mode of the drivers' action noise."""

from typing import Literal

import msgspec

from service.world.scenario.check import check_values
from service.world.scenario.schema import Scenario

NoiseMode = Literal["drawn", "frozen", "searched"]


def with_noise_mode(scenario: Scenario, noise_mode: NoiseMode | None, source: str = "") -> Scenario:
    """The scenario with that noise mode; None leaves it. ScenarioError where it cannot have it."""
    if noise_mode is None:
        return scenario
    changed = _changed(scenario, noise_mode)
    check_values(changed, source or scenario.name)
    return changed


def without_searched_noise(scenario: Scenario) -> Scenario:
    """The scenario whose X ends before its action noise, for what looks at the coordinates before it."""
    return _changed(scenario, "drawn")


def _changed(scenario: Scenario, noise_mode: NoiseMode) -> Scenario:
    drivers = msgspec.structs.replace(scenario.drivers, noise_mode=noise_mode)
    return msgspec.structs.replace(scenario, drivers=drivers)
