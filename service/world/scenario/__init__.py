"""Scenarios: validated TOML files that say which road, which vehicles, which distribution and which measure."""

from service.world.scenario.load import built_in_names, load_scenario
from service.world.scenario.schema import Scenario

__all__ = ["Scenario", "built_in_names", "load_scenario"]
