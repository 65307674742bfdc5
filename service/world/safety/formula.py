"""Signal temporal logic formulas as safety measures: f is the robustness at the start of the rollout.

    stl: always(ttc_s >= 1.0)
    stl: always(box_ttc_s < 2 implies eventually[0:1 s](acceleration_mps2 <= -2))

`service.world.safety.formula_language` reads them, `service.world.safety.robustness` works them out.
"""

from collections.abc import Callable

import numpy as np

from service.world import agents as A
from service.world.safety.boxes import box_time_to_collision, clearance
from service.world.safety.deceleration import required_deceleration
from service.world.safety.formula_language import Program, read_formula
from service.world.safety.robustness import FAR, robustness
from service.world.safety.rss import BOTH, rss_margin, rss_parameters
from service.world.scenario.schema import Scenario

OF_EGO = {
    "speed_mps": A.SPEED_MPS,
    "acceleration_mps2": A.ACCELERATION_MPS2,
    "turn_rate_radps": A.TURN_RATE_RADPS,
    "lane_offset_m": A.LANE_OFFSET_M,
    "lane_heading_rad": A.LANE_HEADING_RAD,
    "left_marking_m": A.LEFT_MARKING_M,
    "right_marking_m": A.RIGHT_MARKING_M,
    "collision": A.COLLISION,
    "off_road": A.OFF_ROAD,
    "reversing": A.REVERSING,
}
OF_ALL = ("ttc_s", "box_ttc_s", "clearance_m", "rss_m", "required_deceleration_mps2")
SIGNALS = (*OF_ALL, *OF_EGO)

Signal = Callable[[np.ndarray, int, float], float]  # of (agents, count, ttc_s)


class FormulaMonitor:
    """A formula over the signals of a rollout. Beyond the rollout's end nothing is demanded and nothing happens."""

    def __init__(self, formula: str, scenario: Scenario):
        step_ms = round(scenario.time.step_s * 1000.0)
        horizon_ms = round(scenario.time.horizon_s * 1000.0)
        self._program = checked_formula(formula, step_ms, horizon_ms)
        self._signals = {name: _signal(name, scenario) for name in self._program.signals}
        self._seen: dict[str, list[float]] = {}
        self._robustness: np.ndarray | None = None

    def reset(self) -> None:
        self._seen = {name: [] for name in self._signals}
        self._robustness = None

    def see(self, agents: np.ndarray, count: int, ttc_s: float) -> None:
        for name, signal in self._signals.items():
            self._seen[name].append(min(max(signal(agents, count, ttc_s), -FAR), FAR))
        self._robustness = None

    def value(self) -> float:
        return float(self.trace()[0])

    def trace(self) -> np.ndarray:
        if self._robustness is None:
            seen = {name: np.array(values, dtype=np.float64) for name, values in self._seen.items()}
            self._robustness = robustness(self._program, seen)
        return self._robustness


def checked_formula(formula: str, step_ms: int, horizon_ms: int) -> Program:
    """The formula as a program over SIGNALS; InputError names what is wrong, and at which character."""
    return read_formula(formula, SIGNALS, step_ms, horizon_ms)


def _signal(name: str, scenario: Scenario) -> Signal:
    ego = scenario.ego
    if name in OF_EGO:
        column = OF_EGO[name]
        return lambda agents, count, ttc_s: float(agents[ego, column])
    if name == "ttc_s":
        return lambda agents, count, ttc_s: ttc_s
    if name == "rss_m":
        parameters = rss_parameters(scenario)
        return lambda agents, count, ttc_s: rss_margin(agents, count, ego, parameters, BOTH)
    of_state = {
        "box_ttc_s": box_time_to_collision,
        "clearance_m": clearance,
        "required_deceleration_mps2": required_deceleration,
    }[name]
    return lambda agents, count, ttc_s: of_state(agents, count, ego)
