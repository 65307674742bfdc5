"""The hub's time."""

from collections.abc import Callable

LONGEST_STEP_S = 5.0  # between two readings of the clock; more is a jump, or a machine that slept


class Elapsed:
    """The hub's time, s: a clock that jumps moves it by LONGEST_STEP_S at most, and never back."""

    def __init__(self, clock: Callable[[], float]):
        self._clock = clock
        self._last = clock()
        self._elapsed = 0.0

    def now(self) -> float:
        reading = self._clock()
        self._elapsed += min(max(reading - self._last, 0.0), LONGEST_STEP_S)
        self._last = reading
        return self._elapsed
