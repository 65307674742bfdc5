"""The rows of a batch that nobody is running: cut into chunks, given back, claimed by answers that come late."""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np


@dataclass(frozen=True)
class Range:
    """Rows [start, stop).

    whole: has been out before and goes out as it is, so that a late answer fits
    losses: times that whoever ran it was lost
    """

    start: int
    stop: int
    whole: bool = False
    losses: int = 0

    @property
    def rows(self) -> int:
        return self.stop - self.start

    def halves(self) -> tuple["Range", "Range"]:
        middle = (self.start + self.stop) // 2
        return Range(self.start, middle, True), Range(middle, self.stop, True)


class Pending:
    """Disjoint ranges, those given back first."""

    def __init__(self, done: np.ndarray, offset: int):
        """All rows that are not `done` (n,), counted from `offset`."""
        edges = np.flatnonzero(np.diff(np.concatenate([[True], done, [True]]).astype(np.int8)))
        pairs = zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True)
        self._ranges = [Range(a + offset, b + offset) for a, b in pairs][::-1]  # the next one is the last
        self.rows = sum(r.rows for r in self._ranges)

    def __bool__(self) -> bool:
        return bool(self._ranges)

    def __iter__(self) -> Iterator[Range]:
        return iter(self._ranges)

    def take(self, rows: int) -> Range:
        """The next range, of at most so many rows where it has not been out before."""
        first = self._ranges.pop()
        if not first.whole and first.rows > rows:
            self._ranges.append(replace(first, start=first.start + rows))
            first = replace(first, stop=first.start + rows)
        self.rows -= first.rows
        return first

    def give_back(self, returned: Range) -> None:
        self._ranges.append(replace(returned, whole=True))
        self.rows += returned.rows

    def claim(self, start: int, stop: int) -> Range | None:
        """The rows [start, stop) where they are all pending in one range; None otherwise."""
        for i, one in enumerate(self._ranges):
            if one.start <= start < stop <= one.stop:
                rest = [replace(one, start=stop), replace(one, stop=start)]
                self._ranges[i : i + 1] = [r for r in rest if r.rows]
                self.rows -= stop - start
                return replace(one, start=start, stop=stop)
        return None
