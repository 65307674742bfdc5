"""Safety measures behind one interface: watch a rollout step by step, then say its value. Low is dangerous for all.

    ttc               s      time to collision by rays (the paper's): the world computes it anyway
    box-ttc           s      time until two boxes touch if all keep their velocities
    ttc-impact        s      box-ttc, above 0; at a contact of the ego minus the impact speed in m/s (safety.impact)
    rss               m      RSS margin; below 0 neither the distance along the road nor the one across it is safe
    rss-longitudinal  m      its margin along the road, of vehicles in each other's way
    rss-lateral       m      its margin across the road, of vehicles side by side
    pet               s      post-encroachment time
    drac              m/s^2  minus the deceleration required: 0 where nobody has to brake, -8 an emergency
    stl: FORMULA             robustness of a signal temporal logic formula (service.world.safety.formula)

The value of a rollout is the smallest of its steps' values; for a formula, its robustness over the whole rollout.
"""

import math
from collections.abc import Callable
from typing import Protocol

import msgspec
import numpy as np

from service.errors import InputError
from service.world.safety import encroachment, rss
from service.world.safety.boxes import box_time_to_collision
from service.world.safety.deceleration import required_deceleration
from service.world.safety.formula import FormulaMonitor
from service.world.safety.impact import time_or_impact
from service.world.scenario.measures import STL, split_measure
from service.world.scenario.schema import Scenario


class Monitor(Protocol):
    """Watches rollouts, one after the other."""

    def reset(self) -> None:
        """A new rollout begins."""

    def see(self, agents: np.ndarray, count: int, ttc_s: float) -> None:
        """The next state of the world.

        ttc_s: the ego's time to collision by rays in it
        """

    def value(self) -> float:
        """f of the rollout so far."""

    def trace(self) -> np.ndarray:
        """The value of each state that was seen, (states,)."""


class StepMonitor:
    """A measure that is worked out from each state alone: f is its smallest value."""

    def __init__(self, of_state: Callable[[np.ndarray, int], float]):
        self._of_state = of_state
        self._values: list[float] = []

    def reset(self) -> None:
        self._values = []

    def see(self, agents: np.ndarray, count: int, ttc_s: float) -> None:
        self._values.append(self._of_state(agents, count))

    def value(self) -> float:
        return min(self._values, default=math.inf)

    def trace(self) -> np.ndarray:
        return np.array(self._values)


class EncroachmentMonitor:
    """Post-encroachment time (s), which needs the states before."""

    def __init__(self, steps: int, rows: int, ego: int, dt_s: float):
        self._history = np.zeros((steps + 1, rows, encroachment.COLUMNS))
        self._ego = ego
        self._dt_s = dt_s
        self._values: list[float] = []

    def reset(self) -> None:
        self._values = []

    def see(self, agents: np.ndarray, count: int, ttc_s: float) -> None:
        k = len(self._values)
        encroachment.remember(agents, count, k, self._history)
        longest = encroachment.LONGEST_S / self._dt_s
        self._values.append(encroachment.encroachment(self._history, k, self._ego, longest) * self._dt_s)

    def value(self) -> float:
        return min(self._values, default=math.inf)

    def trace(self) -> np.ndarray:
        return np.array(self._values)


def open_monitor(scenario: Scenario, rows: int) -> Monitor | None:
    """The monitor of the scenario's measure; None for `ttc`, which the world computes with each observation.

    rows: of the world's agents, background traffic included. InputError where a formula cannot be used.
    """
    name, formula = split_measure(scenario.safety.measure)
    ego, dt_s = scenario.ego, scenario.time.step_s
    if name == "ttc":
        return None
    if name == STL:
        return FormulaMonitor(formula, scenario)
    if name == "pet":
        return EncroachmentMonitor(scenario.steps, rows, ego, dt_s)
    return StepMonitor(step_function(name, scenario))


def with_measure(scenario: Scenario, measure: str) -> Scenario:
    """The scenario with another measure; InputError where there is no such measure or its formula cannot be used."""
    try:
        split_measure(measure)
    except ValueError as error:
        raise InputError(f"measure {measure[:200]!r}: {error}") from error
    changed = msgspec.structs.replace(scenario.safety, measure=measure)
    changed_scenario = msgspec.structs.replace(scenario, safety=changed)
    open_monitor(changed_scenario, len(scenario.vehicles))
    return changed_scenario


def step_function(name: str, scenario: Scenario) -> Callable[[np.ndarray, int], float]:
    """What a measure of single states makes of (agents, count)."""
    ego = scenario.ego
    if name == "box-ttc":
        return lambda agents, count: box_time_to_collision(agents, count, ego)
    if name == "ttc-impact":
        return lambda agents, count: time_or_impact(agents, count, ego)
    if name == "drac":
        return lambda agents, count: 0.0 - required_deceleration(agents, count, ego)
    parameters = rss.rss_parameters(scenario)
    which = {"rss": rss.BOTH, "rss-longitudinal": rss.ALONG, "rss-lateral": rss.ACROSS}[name]
    return lambda agents, count: rss.rss_margin(agents, count, ego, parameters, which)
