"""Numbers as people say them: sensible digits, units, one in so many."""

import math
from collections.abc import Sequence
from typing import NamedTuple

from service.world.scenario.measures import unit_at

_SUPERSCRIPTS = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
NOT_KNOWN = "not known"
DIGITS = 2  # of the uncertainty: half an interval, to which an estimate and its interval's ends are rounded
MOST_DIGITS = 6
LEAST_PERCENT = 0.01


def significant(value: float | None, digits: int = 3) -> str:
    """A number with so many significant digits, thousands separated, powers of ten where it is small."""
    if value is None or math.isnan(value):
        return NOT_KNOWN
    if math.isinf(value):
        return "∞" if value > 0 else "-∞"
    if value == 0.0:
        return "0"
    mantissa, exponent = f"{value:.{digits - 1}e}".split("e")
    power = int(exponent)
    if power < -3 or power > 8:
        return f"{mantissa} × 10{str(power).translate(_SUPERSCRIPTS)}"
    return f"{float(f'{mantissa}e{power}'):,.{max(digits - 1 - power, 0)}f}"


class Told(NamedTuple):
    """An estimate and the ends of its interval, in words."""

    value: str
    low: str
    high: str

    @property
    def span(self) -> str:
        return f"{self.low} to {self.high}"


def told(value: float | None, interval: Sequence[float | None]) -> Told:
    """An estimate with its interval, all to the same place: that of the second digit of half the interval's width, as
    the Guide to the expression of uncertainty in measurement has it; each with two digits at least.

    >>> told(0.00751, (0.0046, 0.0114)).span, told(15.8, (15.6, 16.1)), told(1.0, (0.99955, 1.0)).low
    ('0.0046 to 0.0114', Told(value='15.80', low='15.60', high='16.10'), '0.99955')
    """
    low, high = interval
    ends = [v for v in (low, high) if v is not None and math.isfinite(v)]
    half = 0.5 * (ends[1] - ends[0]) if len(ends) == 2 else 0.0
    place = math.floor(math.log10(half)) - DIGITS + 1 if half > 0.0 else None

    def words(one: float | None, open_end: bool = False) -> str:
        if one is None:
            return "∞" if open_end else NOT_KNOWN
        if place is None or not one or not math.isfinite(one):
            return significant(one, DIGITS)
        digits = math.floor(math.log10(abs(one))) - place + 1
        return significant(one, min(max(digits, DIGITS), MOST_DIGITS))

    return Told(words(value), words(low), words(high, open_end=True))


def is_bound(p: float, interval: Sequence[float | None]) -> bool:
    """Whether an estimate says no more than that p is at most the upper end of its interval."""
    return p == 0.0 or not interval[0]


def quantity(value: float, unit: str) -> str:
    """A value as it was given, with its unit where it has one.

    unit: as a measure's kind has it
    """
    return f"{value:g} {unit_at(unit, value)}".rstrip()


def count(value: float | None) -> str:
    return NOT_KNOWN if value is None else f"{value:,.0f}"


def percent(share: float | None, digits: int = 2) -> str:
    """A share as a percentage; one that nobody would tell from none is below LEAST_PERCENT."""
    if share is None or math.isnan(share):
        return NOT_KNOWN
    if 0.0 < 100.0 * share < LEAST_PERCENT:
        return f"below {LEAST_PERCENT:g}%"
    return f"{significant(100.0 * share, digits)}%"


def factor(value: float | None) -> str:
    """How many times."""
    return NOT_KNOWN if value is None else f"{significant(value, 2)} ×"


def level(confidence: float) -> str:
    """A confidence level."""
    return f"{100.0 * confidence:.4g}%"


def duration(seconds: float) -> str:
    """Seconds as people say them."""
    if seconds < 60:
        return f"{significant(seconds, 2)} s"
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours:,} h {minutes} min" if hours else f"{minutes} min {rest} s"


def treatment(failed: int, total: int) -> str:
    """How failed rollouts were treated in p, "" where none failed."""
    if not failed:
        return ""
    return (
        f"{failed:,} of {total:,} rollouts failed and have no f: no events in p and the interval's lower end, events "
        "in its upper end"
    )


def one_in(p: float) -> str:
    """A probability as one in so many rollouts, or so many in 100 where it is large."""
    if p <= 0:
        return "none"
    return f"{100.0 * p:.0f} in 100" if p >= 0.1 else f"one in {significant(1.0 / p, 2)}"
