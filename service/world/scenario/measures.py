"""The safety measures by name, with their units: what a scenario may ask for. `service.world.safety` computes them."""

import difflib
import math
from typing import NamedTuple

STL = "stl"
IMPACT = "ttc-impact"  # at and below 0 it says that there was a contact, and how fast
BELOW_ZERO = ", below 0 "  # between a measure's unit and that of its values at 0 and below


class MeasureKind(NamedTuple):
    """A measure's unit ("s, below 0 m/s" where values at 0 and below have one of their own), what its value is in
    words, and the smallest value that it can have."""

    unit: str
    words: str
    least: float = -math.inf


MEASURES = {
    "ttc": MeasureKind("s", "smallest time to collision", 0.0),
    "box-ttc": MeasureKind("s", "smallest time until the boxes touch", 0.0),
    IMPACT: MeasureKind(
        f"s{BELOW_ZERO}m/s", "smallest time until the boxes touch, or minus the impact speed"
    ),
    "rss": MeasureKind("m", "smallest RSS margin"),
    "rss-longitudinal": MeasureKind("m", "smallest longitudinal RSS margin"),
    "rss-lateral": MeasureKind("m", "smallest lateral RSS margin"),
    "pet": MeasureKind("s", "smallest post-encroachment time", 0.0),
    "drac": MeasureKind("m/s^2", "hardest deceleration required, below zero,"),
    STL: MeasureKind("", "robustness of the formula"),
}


def unit_at(unit: str, value: float) -> str:
    """The unit of one value of a measure whose unit is `unit`."""
    above, both, below = unit.partition(BELOW_ZERO)
    return below if both and value <= 0.0 else above


def span(unit: str, gamma: float) -> tuple[float, float]:
    """The thresholds between which a curve is drawn for a job that aims at gamma, of a measure with this unit.

    They run from 0 to twice as far; where 0 is a contact, at least from one at 5 m/s to a second before.
    """
    low, high = (-5.0, 1.0) if BELOW_ZERO in unit else (0.0, 0.0)
    return min(low, 2.0 * gamma), max(high, 2.0 * gamma) or 1.0


def check_threshold(measure: str, gamma: float) -> None:
    """ValueError for a threshold that no value of the measure can be at or below."""
    kind = measure_kind(measure)
    if gamma < kind.least:
        reaching = ", ".join(name for name, other in MEASURES.items() if other.least < 0.0)
        raise ValueError(
            f"threshold {gamma:g} {kind.unit}: the measure {measure!r} is never below {kind.least:g}; give a threshold "
            f"of {kind.least:g} or more, or a measure that goes below 0: {reaching}"
        )


def measure_kind(measure: str) -> MeasureKind:
    """Of a measure as scenarios write it: a name, or `stl: FORMULA`."""
    return MEASURES[measure.partition(":")[0]]


def split_measure(measure: str) -> tuple[str, str]:
    """Name and formula ("" for all but stl); ValueError says what is wrong with it."""
    name, colon, formula = measure.partition(":")
    formula = formula.strip()
    if name not in MEASURES:
        close = difflib.get_close_matches(name, MEASURES, 1)
        hint = f"did you mean {close[0]!r}? " if close else ""
        raise ValueError(f"no such measure; {hint}there are {', '.join(MEASURES)}")
    if name == STL and not formula:
        raise ValueError("give its formula too, as in 'stl: always(ttc_s >= 1.0)'")
    if name != STL and colon:
        raise ValueError(f"only {STL} has a formula; give {name!r} alone")
    return name, formula
