"""Tables that fit a terminal of 80 columns without cutting what is read off them."""

import textwrap
from collections.abc import Iterator, Sequence
from typing import TypeVar

from rich.table import Column, Table

T = TypeVar("T")
FOLDED = 20  # characters of a name in one of them, as many as an interval has


def whole(header: str) -> Column:
    """A column whose cells are never wrapped: what other commands take, and intervals. The others give way."""
    return Column(header, no_wrap=True, overflow="ignore")


def dense(*headers: str) -> Table:
    """A table of many columns, all of them whole: no lines, one space between."""
    return Table(*map(whole, headers), box=None, pad_edge=False, padding=(0, 1, 0, 0))


def folded(name: str) -> str:
    """A name that may be long, on as many lines as it takes; none of it is cut."""
    return "\n".join(textwrap.wrap(name, FOLDED))


def side_by_side(given: Sequence[T], at_most: int) -> Iterator[Sequence[T]]:
    """What goes into one table after the other, as not all of it fits beside its labels in 80 columns."""
    return (given[i : i + at_most] for i in range(0, len(given), at_most))
