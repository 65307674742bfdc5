"""What a picture shows, before anything is drawn."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal


@dataclass(frozen=True)
class Series:
    """One line, or points. Values that are not known are None.

    low, high: an interval around each
    tone: one of the page's colours, 1 to 4, 0 for what is compared against, "ego" or "threat"
    """

    name: str
    x: Sequence[float | None]
    y: Sequence[float | None]
    low: Sequence[float | None] = ()
    high: Sequence[float | None] = ()
    tone: int | str = 1
    kind: Literal["line", "points", "steps"] = "line"
    dashed: bool = False


@dataclass(frozen=True)
class Mark:
    """A straight line across the picture at a value of "x" or "y"."""

    axis: Literal["x", "y"]
    value: float
    text: str


@dataclass(frozen=True)
class Chart:
    """What one chart shows.

    shows: what is to be seen, in a sentence, for those who do not see it
    x_whole: whether its values are whole numbers, with no ticks between them
    x_include, y_include: values that the axis shows in any case
    """

    id: str
    title: str
    shows: str
    x_label: str
    y_label: str
    series: tuple[Series, ...]
    marks: tuple[Mark, ...] = ()
    x_log: bool = False
    y_log: bool = False
    x_whole: bool = False
    y_include: tuple[float, ...] = ()
    x_include: tuple[float, ...] = ()
    note: str = ""

    @property
    def empty(self) -> bool:
        """Whether there is nothing to draw."""
        return not any(y is not None for series in self.series for y in series.y)
