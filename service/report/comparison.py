"""A comparison as a page of its own, and as JSON beside it."""

from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path

import msgspec
import numpy as np

from service.comparison.objects import Comparison
from service.errors import StoreError
from service.report import ink
from service.report.ink import Picture
from service.report.page import render
from service.wording import significant

COLOURS = {"a": ink.COLOURS["naive"], "b": ink.COLOURS["ce"]}
STYLES = {"a": "--", "b": "-"}
DECADES = 8


def write_comparison(found: Comparison, path: Path, now: datetime | None = None) -> None:
    """Write the page to `path` and the facts to the same name with .json; StoreError where that cannot be."""
    html = render(
        "versus.html",
        c=found,
        colours=COLOURS,
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


def curves(found: Comparison) -> Picture:
    """p against the threshold, both in one picture."""
    c = found.curves
    gamma = np.array(c.gamma)
    positive = [v for v in (*c.a, *c.b) if v > 0]
    bottom = max(min(positive, default=1e-6) / 5.0, max(positive, default=0.0) * 10.0**-DECADES)
    with ink.figure(3.3) as drawn:
        axes = drawn.add_subplot()
        for key, name, p, low, high in (
            ("a", found.a.name, c.a, c.a_low, c.a_high),
            ("b", found.b.name, c.b, c.b_low, c.b_high),
        ):
            floor = np.maximum(np.array([low, high]), bottom)
            axes.fill_between(gamma, *floor, color=COLOURS[key], alpha=ink.BAND, lw=0)
            shown = np.where(np.array(p) > 0, p, np.nan)
            axes.plot(gamma, shown, color=COLOURS[key], linestyle=STYLES[key], label=f"{key.upper()}: {name}")
        axes.axvline(found.gamma, color=ink.BASE, linewidth=1.0)
        axes.set_xlim(gamma[0], gamma[-1])
        axes.set_ylim(bottom, 1.2)
        ink.log_axis(axes, "y")
        if gamma[0] > 0:
            ink.log_axis(axes, "x", lambda v: f"{v:g}")
        axes.set_xlabel("threshold γ, s")
        axes.set_ylabel("probability of f ≤ γ")
        axes.legend(loc="lower right")
        return ink.picture(
            drawn,
            "Both for other thresholds",
            f"Probability that f is at most gamma for both, from {gamma[0]:.3g} s to {gamma[-1]:.3g} s; at "
            f"{found.gamma:g} s it is {significant(found.a.p)} for {found.a.name} and {significant(found.b.p)} for "
            f"{found.b.name}.",
            "Bands: intervals at each threshold by itself. The vertical line is γ.",
        )
