"""Tables that fit a terminal of 80 columns without cutting what is read off them."""

from rich.table import Column


def whole(header: str) -> Column:
    """A column whose cells are never wrapped: what other commands take, and intervals. The others give way."""
    return Column(header, no_wrap=True, overflow="ignore")
