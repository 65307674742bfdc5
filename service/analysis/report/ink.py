"""How the report's pictures look: colours, type, axes; and pictures as text that a page can hold."""

import base64
import io
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import matplotlib
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from service.analysis.wording import significant

# Okabe and Ito's colours, which people with any colour vision tell apart; line styles differ too.
COLOURS = {"naive": "#0072B2", "ce": "#D55E00", "mixture": "#009E73"}
SPARE_COLOURS = ("#CC79A7", "#56B4E9", "#E69F00")
STYLES = {"naive": "--", "ce": "-", "mixture": "-."}
MARKERS = {"naive": "o", "ce": "s", "mixture": "^"}
BASE = "#6b6b6b"  # the base distribution, and reference lines
EGO, THREAT, OTHER = "#2b86e0", "#d6609f", "#b9b9b9"
WIDTH_IN = 5.0
BAND = 0.18  # opacity of an interval

_STYLE: dict[Any, Any] = {
    "font.size": 9.0,
    "font.family": ["DejaVu Sans"],
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.titlesize": 9.0,
    "axes.titlelocation": "left",
    "axes.labelsize": 9.0,
    "grid.color": "#e6e6e6",
    "grid.linewidth": 0.6,
    "legend.frameon": False,
    "legend.fontsize": 8.5,
    "lines.linewidth": 1.6,
    "svg.fonttype": "path",  # the reader may not have the font
    "svg.hashsalt": "tailroad",  # the same picture has the same bytes
    "text.parse_math": False,  # vehicles may be called anything
    "path.simplify_threshold": 0.3,
}


@dataclass(frozen=True)
class Picture:
    """An SVG picture with what it shows, for those who cannot see it, and a caption for all."""

    title: str
    source: str  # data: URI
    alt: str
    caption: str
    width_px: int
    height_px: int


def colour(method: str) -> str:
    return COLOURS.get(method) or SPARE_COLOURS[sum(method.encode()) % len(SPARE_COLOURS)]


def name_of(vehicle: str, is_ego: bool) -> str:
    """A vehicle's name as pictures have room for it."""
    short = vehicle if len(vehicle) <= 16 else vehicle[:15] + "…"
    return f"{short} (ego)" if is_ego and vehicle != "ego" else short


def line(method: str) -> dict[str, Any]:
    """Keyword arguments of a method's lines."""
    return {"color": colour(method), "linestyle": STYLES.get(method, "-.")}


@contextmanager
def figure(height_in: float, width_in: float = WIDTH_IN) -> Iterator[Figure]:
    """A figure in the report's style."""
    with matplotlib.rc_context(_STYLE), warnings.catch_warnings():
        warnings.filterwarnings("ignore", message="Glyph")  # a name in a script that the font lacks
        yield Figure(figsize=(width_in, height_in), layout="constrained")


def picture(drawn: Figure, title: str, alt: str, caption: str) -> Picture:
    """The finished figure; to be called while its style holds."""
    out = io.BytesIO()
    drawn.savefig(out, format="svg", metadata={"Date": None, "Creator": None})
    width_in, height_in = drawn.get_size_inches()
    source = "data:image/svg+xml;base64," + base64.b64encode(out.getvalue()).decode("ascii")
    return Picture(title, source, alt, caption, round(width_in * 96), round(height_in * 96))


def log_axis(axes: Axes, which: str, label: Callable[[float], str] | None = None) -> None:
    """Make `which` ("x" or "y") of the axes logarithmic, with labels that say the number.

    To be called when the limits stand.
    """
    (axes.set_xscale if which == "x" else axes.set_yscale)("log")
    axis = axes.xaxis if which == "x" else axes.yaxis
    low, high = axes.get_xlim() if which == "x" else axes.get_ylim()
    ratio = high / low if low > 0 else 1e9
    subs: tuple[float, ...] = (1.0, 2.0, 5.0) if ratio < 200 else (1.0,)
    if ratio < 4:
        subs = tuple(float(s) for s in range(1, 10))
    axis.set_major_locator(LogLocator(base=10.0, subs=subs, numticks=12))
    say = label or (lambda value: significant(value, 1).removeprefix("1 × "))
    axis.set_major_formatter(FuncFormatter(lambda value, _: say(value)))
    axis.set_minor_formatter(NullFormatter())


def thousands(axes: Axes) -> None:
    axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:,.0f}"))
