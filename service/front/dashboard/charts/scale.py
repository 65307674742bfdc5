"""From values to places on paper, and where the ticks go."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from service.analysis.wording import significant

ROOM = 0.04  # of an axis, beyond the data
FACTOR = 1.25  # the same for a logarithmic axis


@dataclass(frozen=True)
class Scale:
    """Values from low to high at places from start to end.

    log: low is above 0
    whole: of whole numbers, between which there are no ticks
    """

    low: float
    high: float
    start: float
    end: float
    log: bool = False
    whole: bool = False

    def __call__(self, value: float) -> float:
        """The place of a value, kept inside."""
        low, high = (math.log(self.low), math.log(self.high)) if self.log else (self.low, self.high)
        at = math.log(max(value, self.low)) if self.log else value
        share = (at - low) / (high - low)
        return self.start + min(max(share, 0.0), 1.0) * (self.end - self.start)

    def ticks(self, most: int) -> list[tuple[float, str]]:
        """Values to be marked, with what is written there."""
        values = _log_ticks(self.low, self.high, most) if self.log else self._even_ticks(most)
        return [(value, tick_label(value)) for value in values]

    def _even_ticks(self, most: int) -> list[float]:
        return _even_ticks(self.low, self.high, most, 1.0 if self.whole else 0.0)


def fitting(
    values: Iterable[float],
    start: float,
    end: float,
    log: bool = False,
    include: Sequence[float] = (),
    whole: bool = False,
) -> Scale:
    """A scale that shows all the values; on a logarithmic one those above 0."""
    shown = [v for v in (*values, *include) if math.isfinite(v) and (v > 0.0 or not log)]
    low, high = (min(shown), max(shown)) if shown else (0.1, 1.0) if log else (0.0, 1.0)
    if log:
        return Scale(low / FACTOR, high * FACTOR, start, end, True)
    room = ROOM * (high - low) or 0.5 * abs(high) or 0.5
    below = 0.0 if low == 0.0 else room  # nothing lies below a count of none
    return Scale(low - below, high + room, start, end, whole=whole)


def tick_label(value: float) -> str:
    """A tick's value, short."""
    if value and (abs(value) >= 1e5 or abs(value) < 1e-3):
        return significant(value, 1).removeprefix("1 × ").replace(" × ", "·")
    return f"{value:,.6g}"


def _even_ticks(low: float, high: float, most: int, least: float = 0.0) -> list[float]:
    """Values at equal distances, of at least `least`."""
    raw = max((high - low) / max(most, 1), least)
    power = 10.0 ** math.floor(math.log10(raw))
    step = next(
        s * power
        for s in (1.0, 2.0, 2.5, 5.0, 10.0)
        if s * power >= raw * (1.0 - 1e-9) and _is_whole(s * power, least)
    )
    first = math.ceil(low / step - 1e-9)
    last = math.floor(high / step + 1e-9)
    return [min(max(float(f"{i * step:.12g}"), low), high) for i in range(first, last + 1)]


def _is_whole(step: float, least: float) -> bool:
    return not least or step == math.floor(step)


def _log_ticks(low: float, high: float, most: int) -> list[float]:
    powers = range(math.floor(math.log10(low)), math.ceil(math.log10(high)) + 1)
    for digits in ((1, 2, 3, 5), (1, 2, 5), (1, 3), (1,)):
        found = [d * 10.0**p for p in powers for d in digits if low <= d * 10.0**p <= high]
        if len(found) <= most:
            break
    else:
        found = found[:: math.ceil(len(found) / most)]
    return found if len(found) > 1 else _even_ticks(low, high, most)
