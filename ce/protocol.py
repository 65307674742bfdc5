"""What every algorithm offers: the interface that the service drives."""

from typing import Any, Protocol

from numpy.typing import ArrayLike

from ce.product import Product
from ce.results import Estimate
from ce.state import Batch, EstimationRecord, TrainingRecord


class Algorithm(Protocol):
    """Pure functions of a frozen state; the state's type is the algorithm's own."""

    @property
    def method(self) -> str:
        """Name, as given to `ce.algorithm`."""

    @property
    def base(self) -> Product: ...

    @property
    def gamma(self) -> float: ...

    @property
    def total_rollouts(self) -> int:
        """Calls of f at most, training included."""

    def init(self, seed: int = 0) -> Any:
        """The state before any rollout."""

    def propose(self, state: Any) -> Batch | None:
        """The next batch; None when finished."""

    def update(self, state: Any, batch: Batch, f: ArrayLike) -> tuple[Any, TrainingRecord | EstimationRecord]:
        """The state after the batch was answered with f (n,), NaN = failed rollout, and what happened."""

    def estimate(self, state: Any) -> Estimate:
        """The estimate so far, at any time."""

    def proposal(self, state: Any) -> Product:
        """The distribution being sampled now."""

    def to_bytes(self, state: Any) -> bytes: ...

    def from_bytes(self, data: bytes) -> Any:
        """The state that `to_bytes` wrote for the same base, gamma and options; StateError otherwise."""
