"""The safety measures by name, with their units: what a scenario may ask for. `service.world.safety` computes them."""

import difflib
from typing import NamedTuple

STL = "stl"


class MeasureKind(NamedTuple):
    """A measure's unit, what its value is in words, and the value from which on there is no danger at all."""

    unit: str
    words: str


MEASURES = {
    "ttc": MeasureKind("s", "smallest time to collision"),
    "box-ttc": MeasureKind("s", "smallest time until the boxes touch"),
    "rss": MeasureKind("m", "smallest RSS margin"),
    "rss-longitudinal": MeasureKind("m", "smallest longitudinal RSS margin"),
    "rss-lateral": MeasureKind("m", "smallest lateral RSS margin"),
    "pet": MeasureKind("s", "smallest post-encroachment time"),
    "drac": MeasureKind("m/s^2", "hardest deceleration required, below zero,"),
    STL: MeasureKind("", "robustness of the formula"),
}


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
