"""A comparison in words."""

from collections.abc import Sequence

from service.analysis.comparison.objects import Difference, ModeChange, Pairs, Side
from service.analysis.wording import level, significant


def pair_summary(
    sides: tuple[Side, Side],
    difference: Difference,
    modes: Sequence[ModeChange],
    event: str,
    confidence: float,
    draws: Pairs | None = None,
) -> str:
    """What the comparison comes to, in a few sentences, the first of which is the conclusion.

    event: as in "f <= 0.5 s"
    draws: where both ran the same ones
    """
    a, b = sides
    low, high = difference.difference_ci
    sure = level(confidence)
    if difference.clear:
        verdict = (
            f"{b.name} meets the event {'more' if difference.difference > 0 else 'less'} often than {a.name}"
        )
    else:
        verdict = f"No clear difference between {a.name} and {b.name}"
    sentences = [
        f"{verdict}: p({event}) is {_p(b)} against {_p(a)}, a difference of {_signed(difference.difference)} "
        f"({sure} interval {_signed(low)} to {_signed(high)})"
    ]
    if difference.ratio is not None:
        least, most = difference.ratio_ci
        upper = "no upper end" if most is None else significant(most, 2)
        between = f"{significant(least, 2)} to {upper}"
        times = f"{significant(difference.ratio, 2)} times as often ({between})" if difference.clear else ""
        sentences[0] += f", or {times}" if times else f"; the ratio may be anything from {between}"
    sentences[0] += "."
    if draws is not None and draws.p_value is not None:
        sentences.append(
            f"Of the same draws {draws.only_b:,} were dangerous to {b.name} alone and {draws.only_a:,} to {a.name} "
            f"alone (exact test of McNemar: p-value {significant(draws.p_value, 2)})."
        )
    for change, what in (("appeared", f"in {b.name} only"), ("vanished", f"in {a.name} only"),
                         ("more", f"more often in {b.name}"), ("less", f"less often in {b.name}")):  # fmt: skip
        found = "; ".join(mode.name for mode in modes if mode.change == change)
        if found:
            sentences.append(f"Ways to fail met {what}: {found}.")
    chance = sum(mode.change == "unclear" for mode in modes)
    if chance:
        others = "other " if chance < len(modes) else ""
        ways = f"the {chance} {others}ways" if chance > 1 else f"the {others}way"
        sentences.append(f"In {ways} to fail they are not distinguishable.")
    return " ".join(sentences)


def _p(side: Side) -> str:
    return significant(side.p, 2)


def _signed(value: float) -> str:
    return ("+" if value > 0 else "") + significant(value, 2)
