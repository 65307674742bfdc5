"""The film's charts over time: the safety measure and its worst value so far, and what the ego does."""

import math

import cv2
import numpy as np

from policies.layout import MAX_ACCELERATION_MPS2, MAX_DECELERATION_MPS2, MAX_TURN_RATE_RADPS
from service.analysis.trace import Trace
from service.analysis.video.ink import BACKGROUND, DANGER, EGO, GRID, QUIET, TEXT, TURN, Colour, write
from service.world.scenario.measures import STL, measure_kind, unit_at

LEFT, TOP, RIGHT, BOTTOM = 62, 26, 14, 22  # margins in pixels
MOST_S = 10.0  # times longer than this are drawn at the chart's edge


class Chart:
    """A chart of series over the rollout's time; `draw(k)` shows what has been up to state k."""

    def __init__(self, title: str, time_s: np.ndarray, low: float, high: float, width: int, height: int):
        self._title = title
        self._time_s = time_s
        self._low, self._high = low, high
        self._width, self._height = width, height
        self._series: list[tuple[np.ndarray, Colour, str]] = []

    def add(self, values: np.ndarray, colour: Colour, name: str) -> None:
        """A series (n,) over the first n times."""
        self._series.append((values, colour, name))

    def draw(self, k: int) -> np.ndarray:
        image = np.full((self._height, self._width, 3), BACKGROUND, np.uint8)
        bottom, right = self._height - BOTTOM, self._width - RIGHT
        cv2.rectangle(image, (LEFT, TOP), (right, bottom), GRID, 1)
        for value in (self._low, 0.5 * (self._low + self._high), self._high):
            row = self._row(value)
            cv2.line(image, (LEFT, row), (right, row), GRID, 1)
            write(image, f"{value:.3g}", (8, row + 4), 0.4, QUIET)
        if self._low < 0.0 < self._high:
            cv2.line(image, (LEFT, self._row(0.0)), (right, self._row(0.0)), QUIET, 1)
        write(image, self._title, (LEFT, TOP - 9), 0.42, TEXT)
        column = LEFT + 12 + 8 * len(self._title)
        for values, colour, name in self._series:
            shown = values[: k + 1]
            points = [
                (self._column(t), self._row(v))
                for t, v in zip(self._time_s, shown, strict=False)
                if not math.isnan(v)
            ]
            if len(points) > 1:
                cv2.polylines(image, [np.array(points, np.int32)], False, colour, 2, cv2.LINE_AA)
            if points:
                cv2.circle(image, points[-1], 4, colour, -1, cv2.LINE_AA)
            write(image, name, (column, TOP - 9), 0.42, colour)
            column += 16 + 8 * len(name)
        write(image, f"{self._time_s[-1]:.1f} s", (right - 44, bottom + 15), 0.4, QUIET)
        return image

    def _column(self, time_s: float) -> int:
        share = time_s / max(float(self._time_s[-1]), 1e-9)
        return round(LEFT + share * (self._width - RIGHT - LEFT))

    def _row(self, value: float) -> int:
        share = (min(max(value, self._low), self._high) - self._low) / (self._high - self._low)
        return round(self._height - BOTTOM - share * (self._height - BOTTOM - TOP))


def measure_chart(trace: Trace, width: int, height: int) -> Chart:
    """The measure at each state, and f so far: the smallest value up to there.

    A formula's value at a state looks ahead in time, so there is no f so far.
    """
    name = trace.measure.partition(":")[0]
    kind = measure_kind(trace.measure)
    low, high = _limits(trace.measured, kind.unit)
    unit = f", {kind.unit}" if kind.unit else ""
    chart = Chart(f"{name}{unit}", trace.time_s, low, high, width, height)
    if name != STL:
        chart.add(np.minimum.accumulate(trace.measured), DANGER, "f so far")
    chart.add(trace.measured, EGO, "now" if name != STL else "robustness from here on")
    return chart


def _limits(values: np.ndarray, unit: str) -> tuple[float, float]:
    finite = values[np.isfinite(values)]
    if unit_at(unit, MOST_S) == "s":
        return float(finite.min(initial=0.0)), MOST_S
    if not finite.size:
        return -1.0, 1.0
    low, high = min(float(finite.min()), 0.0), float(np.quantile(finite, 0.95))
    return low, max(high, low + 1.0)


def action_chart(trace: Trace, width: int, height: int) -> Chart:
    """The ego's acceleration and turn rate as shares of the most a vehicle can do."""
    chart = Chart("actions, share of the possible", trace.time_s, -1.0, 1.0, width, height)
    if not len(trace.actions):
        return chart
    acceleration, turn = trace.actions[:, 0], trace.actions[:, 1]
    chart.add(
        np.where(
            acceleration >= 0.0, acceleration / MAX_ACCELERATION_MPS2, acceleration / MAX_DECELERATION_MPS2
        ),
        EGO,
        "acceleration",
    )
    chart.add(turn / MAX_TURN_RATE_RADPS, TURN, "turn rate, left up")
    return chart
