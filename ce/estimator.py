"""What every algorithm is made of: a base distribution, a threshold and options, checked once."""

import functools
from dataclasses import dataclass
from typing import Any, ClassVar, Generic, TypeVar

import msgspec

from ce.checks import checked_problem
from ce.codec import digest_of, from_bytes, to_bytes
from ce.product import Product
from ce.streams import checked_seed

S = TypeVar("S", bound=msgspec.Struct)


@dataclass(frozen=True)
class Estimator(Generic[S]):
    """An algorithm for p = P0(f(X) <= gamma) whose states are of type S.

    The algorithms derive from it, saying their name and state type: `class Naive(Estimator[NaiveState], method="naive",
    state_type=NaiveState)`.

    base: distribution P0 of X
    gamma: threshold of the event, in the unit of f
    options: of the algorithm's own kind
    """

    base: Product
    gamma: float
    options: Any

    method: ClassVar[str]
    state_type: ClassVar[type[msgspec.Struct]]

    def __init_subclass__(cls, method: str = "", state_type: type[msgspec.Struct] = msgspec.Struct) -> None:
        super().__init_subclass__()
        cls.method, cls.state_type = method, state_type

    def __post_init__(self) -> None:
        base, gamma = checked_problem(self.base, self.gamma)
        object.__setattr__(self, "base", base)
        object.__setattr__(self, "gamma", gamma)

    def init(self, seed: int = 0) -> S:
        """The state before any rollout.

        seed: 0 <= seed < 2^64, of all its streams
        """
        return self._initial(checked_seed(seed))

    def _initial(self, seed: int) -> S:
        raise NotImplementedError

    @property
    def total_rollouts(self) -> int:
        """Calls of f at most, training included."""
        return int(self.options.budget)

    @functools.cached_property
    def digest(self) -> str:
        """Of the problem and the options: a state belongs to one digest."""
        return digest_of(self.base, self.method, self.gamma, self.options)

    def to_bytes(self, state: S) -> bytes:
        """The state as MessagePack."""
        return to_bytes(state)

    def from_bytes(self, data: bytes) -> S:
        """The state that `to_bytes` wrote, for this base, gamma and options; StateError otherwise."""
        return from_bytes(data, self.state_type, self.digest)  # type: ignore[return-value]
