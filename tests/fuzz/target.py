"""One thing that is fuzzed."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from hypothesis import strategies as st


@dataclass(frozen=True)
class Target:
    """run: tells how a payload ended, and raises where it did not end as it must; share: of all payloads."""

    name: str
    payloads: st.SearchStrategy[Any]
    run: Callable[[Any], str]
    share: float


def ending(read: Callable[[], object], *refusals: type[Exception]) -> str:
    """How it ended to read something: accepted, or refused, then with the refusal's name. All else is raised."""
    try:
        read()
    except refusals as error:
        return type(error).__name__
    return "accepted"
