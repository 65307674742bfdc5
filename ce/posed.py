"""What every algorithm is made of: a base distribution, a threshold and options, checked once."""

import functools
from dataclasses import dataclass
from typing import Any, ClassVar

from ce.checks import checked_problem
from ce.product import Product
from ce.state import digest_of, from_bytes, to_bytes


@dataclass(frozen=True)
class Posed:
    """p = P0(f(X) <= gamma), X from `base`, to be found with `options`; the algorithms derive from it."""

    base: Product
    gamma: float
    options: Any

    method: ClassVar[str]
    state_kind: ClassVar[type]

    def __post_init__(self) -> None:
        base, gamma = checked_problem(self.base, self.gamma)
        object.__setattr__(self, "base", base)
        object.__setattr__(self, "gamma", gamma)

    @functools.cached_property
    def digest(self) -> str:
        """Of the problem and the options: a state belongs to one digest."""
        return digest_of(self.base, self.method, self.gamma, self.options)

    def to_bytes(self, state: Any) -> bytes:
        return to_bytes(state)

    def from_bytes(self, data: bytes) -> Any:
        """The state that `to_bytes` wrote, for this base, gamma and options; StateError otherwise."""
        return from_bytes(data, self.state_kind, self.digest)
