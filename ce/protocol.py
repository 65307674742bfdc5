"""What every algorithm offers: the interface that the service drives."""

from typing import Protocol, TypeVar

from numpy.typing import ArrayLike

from ce.product import Product
from ce.records import Batch, EstimationRecord, TrainingRecord
from ce.results import Estimate

S = TypeVar("S")


class Algorithm(Protocol[S]):
    """Pure functions of a frozen state of type S, the algorithm's own.

    >>> import ce
    >>> base = ce.Product([ce.Beta(2, 2)])
    >>> algorithm = ce.algorithm("naive", base, gamma=0.1, options=ce.NaiveOptions(budget=4000, batch_size=2000))
    >>> state = algorithm.init(seed=7)
    >>> while (batch := algorithm.propose(state)) is not None:
    ...     state, record = algorithm.update(state, batch, batch.x[:, 0])
    ...     print(record.phase, record.rollouts, record.events)
    estimate 2000 60
    estimate 4000 112
    >>> algorithm.estimate(state).p
    0.028
    """

    @property
    def method(self) -> str:
        """Name, as given to `ce.algorithm`."""

    @property
    def base(self) -> Product:
        """Distribution P0 of X."""

    @property
    def gamma(self) -> float:
        """Threshold of the event, in the unit of f."""

    @property
    def total_rollouts(self) -> int:
        """Calls of f at most, training included."""

    def init(self, seed: int = 0) -> S:
        """The state before any rollout."""

    def propose(self, state: S) -> Batch | None:
        """The next batch; None when finished."""

    def update(self, state: S, batch: Batch, f: ArrayLike) -> tuple[S, TrainingRecord | EstimationRecord]:
        """The state after the batch was answered with f (n,), NaN = failed rollout, and what happened."""

    def estimate(self, state: S) -> Estimate:
        """The estimate so far, at any time."""

    def proposal(self, state: S) -> Product:
        """The distribution being sampled now."""

    def to_bytes(self, state: S) -> bytes:
        """The state as MessagePack."""

    def from_bytes(self, data: bytes) -> S:
        """The state that `to_bytes` wrote for the same base, gamma and options; StateError otherwise."""
