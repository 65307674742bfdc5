"""Signal temporal logic formulas as safety measures, by rtamt: f is the robustness at the start of the rollout.

    stl: always(ttc_s >= 1.0)
    stl: always(box_ttc_s < 2 implies eventually[0:1 s](acceleration_mps2 <= -2))

rtamt's own language can import Python modules and has operators whose cost or bits nobody bounds, so a formula is read
here first, word by word: signals, numbers, the operators below, and intervals within the horizon in whole steps.
"""

import difflib
import re
from collections.abc import Callable
from typing import Any

import numpy as np

from service.errors import InputError
from service.world import agents as A
from service.world.safety.boxes import box_time_to_collision, clearance
from service.world.safety.deceleration import required_deceleration
from service.world.safety.rss import BOTH, rss_margin, rss_parameters
from service.world.scenario.schema import Scenario

LONGEST = 2000  # characters
DEEPEST = 40  # brackets in each other
FAR = 1000.0  # a signal that is infinite (no vehicle closing in, no vehicle at all) counts as this much
TEMPORAL = {"always", "eventually", "until", "historically", "once", "since"}
PREFIX = {"not", "abs", "sqrt", "always", "eventually", "historically", "once"}
BINARY = {"and", "or", "implies", "until", "since", "->", ">=", "<=", ">", "<", "+", "-", "*"}
WORDS = {word for word in PREFIX | BINARY if word.isalpha()}
TOKEN = re.compile(
    r"\s*(?:(?P<word>[A-Za-z_]\w*)|(?P<number>\d+(?:\.\d*)?(?:[eE][+-]?\d+)?)|(?P<sign>->|>=|<=|[-+*()><]))"
)
TIME = r"(\d+(?:\.\d*)?)\s*(s|ms)?"
INTERVAL = re.compile(rf"\s*\[\s*{TIME}\s*[:,]\s*{TIME}\s*\]")
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
        text, names = checked_formula(formula, step_ms, horizon_ms)
        self._specification = _specification(text, names, step_ms)
        self._signals = {name: _signal(name, scenario) for name in names}
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
            states = len(next(iter(self._seen.values())))
            found = self._specification.evaluate({"time": list(range(states)), **self._seen})
            self._robustness = np.array([value for _, value in found], dtype=np.float64)
        return self._robustness


def checked_formula(formula: str, step_ms: int, horizon_ms: int) -> tuple[str, list[str]]:
    """The formula with its intervals in milliseconds, and the signals in it; InputError names what is wrong where."""

    def refuse(what: str, at: int) -> InputError:
        return InputError(f"formula {formula[:200]!r}: {what} (character {at + 1})")

    if len(formula) > LONGEST:
        raise InputError(f"a formula of {len(formula)} characters; at most {LONGEST} are taken")
    made: list[str] = []
    names: list[str] = []
    at = depth = 0
    operand_due = True
    end = len(formula.rstrip())
    while at < end:
        if interval := INTERVAL.match(formula, at):
            if not made or made[-1] not in TEMPORAL:
                raise refuse(f"an interval follows one of {', '.join(sorted(TEMPORAL))}", at)
            text, wrong = _interval(interval, step_ms, horizon_ms)
            if wrong:
                raise refuse(wrong, at)
            made[-1] += text
            at = interval.end()
            continue
        token = TOKEN.match(formula, at)
        if token is None:
            given = formula[at:].strip()[:1]
            raise refuse(f"{given!r} is not part of the language; see service/world/safety/formula.py", at)
        text = token[0].strip()
        if token["word"] and text not in WORDS:
            if text not in SIGNALS:
                close = difflib.get_close_matches(text, [*SIGNALS, *WORDS], 1)
                hint = f"did you mean {close[0]!r}? " if close else ""
                raise refuse(f"no signal {text!r}; {hint}there are {', '.join(SIGNALS)}", at)
            if text not in names:
                names.append(text)
        if operand_due and (text in BINARY - {"-"} or text == ")"):
            raise refuse(f"a signal, a number or a bracket is due, not {text!r}", at)
        if not operand_due and not (text in BINARY or text == ")"):
            raise refuse(f"an operator is due, not {text!r}", at)
        operand_due = text in BINARY or text in PREFIX or text == "("
        depth += (text == "(") - (text == ")")
        if depth < 0:
            raise refuse("')' closes no bracket", at)
        if depth > DEEPEST:
            raise refuse(f"more than {DEEPEST} brackets in each other", at)
        made.append(text)
        at = token.end()
    if operand_due:
        raise refuse("it ends where a signal, a number or a bracket is due", end)
    if depth:
        raise refuse(f"{depth} bracket{'s are' if depth > 1 else ' is'} not closed", end)
    if not names:
        raise refuse(f"it has no signal; there are {', '.join(SIGNALS)}", 0)
    return " ".join(made), names


def _interval(found: re.Match[str], step_ms: int, horizon_ms: int) -> tuple[str, str]:
    """An interval in milliseconds (one without a unit is in seconds), or what is wrong with it."""
    first, first_unit, last, last_unit = found.groups()
    low, high = _ms(first, first_unit or last_unit), _ms(last, last_unit)
    if low <= high <= horizon_ms and low % step_ms == 0 and high % step_ms == 0:
        return f"[{low:.0f} ms:{high:.0f} ms]", ""
    return "", (
        f"the interval {found[0].strip()} must go forward in whole steps of {step_ms} ms, up to the horizon of "
        f"{horizon_ms} ms"
    )


def _ms(number: str, unit: str | None) -> float:
    return round(float(number) * (1.0 if unit == "ms" else 1000.0), 6)


def _specification(
    text: str, names: list[str], step_ms: int
) -> Any:  # a specification of rtamt, which comes without types
    try:
        import rtamt
    except ModuleNotFoundError as error:
        raise InputError(
            "formulas need rtamt, which there is for Python 3.11 and 3.12; use one of these, or another measure"
        ) from error

    specification = rtamt.StlDiscreteTimeOfflineSpecification()
    for name in names:
        specification.declare_var(name, "float")
    specification.set_sampling_period(step_ms, "ms", 0.1)
    specification.spec = text
    try:
        specification.parse()
    except rtamt.RTAMTException as error:
        raise InputError(f"formula {text[:200]!r} cannot be read: {error}") from error
    return specification


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
