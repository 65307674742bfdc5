"""A comparison as a page of its own, and as JSON beside it."""

from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path

import msgspec
import numpy as np

from service.analysis.comparison.objects import Comparison
from service.analysis.report import ink
from service.analysis.report.ink import Picture
from service.analysis.report.page import render
from service.analysis.wording import significant
from service.errors import StoreError

COLOURS = (*ink.COLOURS.values(), *ink.SPARE_COLOURS)  # one after the other for the sides
STYLES = ("--", "-", "-.", ":")
DECADES = 8


def write_comparison(found: Comparison, path: Path, now: datetime | None = None) -> None:
    """Write the page to `path` and the facts to the same name with .json; StoreError where that cannot be."""
    html = render(
        "versus.html",
        c=found,
        colours=[colour_of(i) for i in range(len(found.sides))],
        pictures=[curves(found)],
        version=version("tailroad"),
        made=(now or datetime.now(UTC)).isoformat(timespec="seconds"),
    )
    try:
        path.write_text(html, encoding="utf-8")
        path.with_suffix(".json").write_bytes(
            msgspec.json.format(msgspec.json.encode(found), indent=1) + b"\n"
        )
    except OSError as error:
        raise StoreError(f"cannot write {path}: {error.strerror or error}; give another --html") from error


def colour_of(side: int) -> str:
    return COLOURS[side % len(COLOURS)]


def curves(found: Comparison) -> Picture:
    """p against the threshold, all in one picture."""
    c = found.curves
    gamma = np.array(c.gamma)
    positive = [v for line in c.sides for v in line.p if v]
    bottom = max(min(positive, default=1e-6) / 5.0, max(positive, default=0.0) * 10.0**-DECADES)
    with ink.figure(3.3) as drawn:
        axes = drawn.add_subplot()
        for i, (side, line) in enumerate(zip(found.sides, c.sides, strict=True)):
            floor = np.maximum(np.array([line.low, line.high]), bottom)
            axes.fill_between(gamma, *floor, color=colour_of(i), alpha=ink.BAND, lw=0)
            shown = np.array([v or np.nan for v in line.p])
            axes.plot(gamma, shown, color=colour_of(i), linestyle=STYLES[i % len(STYLES)], label=side.name)
        axes.axvline(found.gamma, color=ink.BASE, linewidth=1.0)
        axes.set_xlim(gamma[0], gamma[-1])
        axes.set_ylim(bottom, 1.2)
        ink.log_axis(axes, "y")
        if gamma[0] > 0:
            ink.log_axis(axes, "x", lambda v: f"{v:g}")
        axes.set_xlabel("threshold γ")
        axes.set_ylabel("probability of f ≤ γ")
        axes.legend(loc="lower right")
        at_gamma = "; ".join(f"{significant(side.p)} for {side.name}" for side in found.sides)
        return ink.picture(
            drawn,
            "All for other thresholds",
            f"Probability that f is at most gamma, from {gamma[0]:.3g} to {gamma[-1]:.3g}; at {found.gamma:g} it is "
            f"{at_gamma}.",
            "Bands: intervals at each threshold by itself. The vertical line is γ.",
        )
