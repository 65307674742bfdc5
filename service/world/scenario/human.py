"""A scenario with another probability that its drivers look away in a conflict."""

import math

import msgspec

from service.errors import ScenarioError
from service.world.scenario.check import check_values
from service.world.scenario.schema import Scenario


def with_epsilon(scenario: Scenario, epsilon: float | None, source: str = "") -> Scenario:
    """The scenario with that epsilon; None leaves it. ScenarioError where it lies outside [0, 1], or where the
    scenario's drivers are not human."""
    if epsilon is None:
        return scenario
    source = source or scenario.name
    if not math.isfinite(epsilon):
        raise ScenarioError(source, "human.glances.epsilon", epsilon, "a probability lies between 0 and 1")
    if scenario.human is None:
        raise ScenarioError(source, "human", None, "missing; only drivers with a human table look away")
    glances = msgspec.structs.replace(scenario.human.glances, epsilon=epsilon)
    changed = msgspec.structs.replace(
        scenario, human=msgspec.structs.replace(scenario.human, glances=glances)
    )
    check_values(changed, source)
    return changed
