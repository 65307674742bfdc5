"""A comparison in words."""

from collections.abc import Sequence

from service.comparison.objects import Difference, ModeChange, Side
from service.wording import level, significant


def said_of(
    sides: tuple[Side, Side],
    difference: Difference,
    modes: Sequence[ModeChange],
    gamma: float,
    confidence: float,
) -> str:
    """What the comparison comes to, in a few sentences."""
    a, b = sides
    low, high = difference.difference_ci
    sure = level(confidence)
    if difference.clear:
        verdict = (
            f"{b.name} meets the event {'more' if difference.difference > 0 else 'less'} often than {a.name}"
        )
    else:
        verdict = f"No clear difference between {a.name} and {b.name}"
    said = [
        f"{verdict}: p(f <= {gamma:g}) is {_p(b)} against {_p(a)}, a difference of {_signed(difference.difference)} "
        f"({sure} interval {_signed(low)} to {_signed(high)})"
    ]
    if difference.ratio is not None:
        least, most = difference.ratio_ci
        upper = "no upper end" if most is None else significant(most, 2)
        said[0] += (
            f", or {significant(difference.ratio, 2)} times as often ({significant(least, 2)} to {upper})"
        )
    said[0] += "."
    for change, what in (("appeared", f"in {b.name} only"), ("vanished", f"in {a.name} only")):
        found = [m for m in modes if m.change == change]
        if found:
            named = "; ".join(f"{m.name}{'' if m.difference.clear else ' (may be chance)'}" for m in found)
            said.append(f"Ways to fail met {what}: {named}.")
    return " ".join(said)


def _p(side: Side) -> str:
    return significant(side.p, 2)


def _signed(value: float) -> str:
    return ("+" if value > 0 else "") + significant(value, 2)
