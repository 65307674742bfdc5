"""What an algorithm asks for and what it tells of each answer: batches of rollouts and flat records."""

import msgspec
import numpy as np
from numpy.typing import NDArray


class Batch(msgspec.Struct, frozen=True, eq=False):
    """Rows [start, stop) of the stream (seed, phase, iteration), to be answered by one f each.

    A worker that holds the base draws the same rows alone:
    `draw(base.with_parameters(parameters), seed, phase, iteration, start, stop)`.

    phase: "train" or "estimate"
    iteration: number of the batch stream within the phase
    x: (n, d), in the coordinates' own units
    noise: (n,) uint64, each rollout's own seed
    parameters: (s,), of the proposal, as `Product.parameters` has them
    seed: of the stream
    start: first row
    stop: the row after the last
    explicit: whether x is not such a draw and has to travel with the batch; parameters then only describe it
    """

    phase: str
    iteration: int
    x: NDArray[np.float64]
    noise: NDArray[np.uint64]
    parameters: NDArray[np.float64]
    seed: int
    start: int
    stop: int
    explicit: bool = False


class TrainingRecord(msgspec.Struct, frozen=True):
    """One batch of a search.

    iteration: number of the batch
    rollouts: in the batch
    gamma_k: max(gamma, quantile), or the largest finite f where the quantile is infinite
    quantile: rho-quantile of f under the sampled proposal
    elites: rollouts with f <= gamma_k
    ess: effective number of elites, by their weights p0 / p_theta
    max_weight_share: the largest of these weights over their sum
    events: rollouts with f <= gamma
    infinite: rollouts with f = +inf
    failed: rollouts with f = NaN
    step: the step taken in (0, 1], 0 where the proposal stayed
    kl: KL(sampled proposal || base), nats
    summary: the sampled proposal's parameters in a few numbers, by name
    phase: "train"
    """

    iteration: int
    rollouts: int
    gamma_k: float
    quantile: float
    elites: int
    ess: float
    max_weight_share: float
    events: int
    infinite: int
    failed: int
    step: float
    kl: float
    summary: dict[str, float]
    phase: str = "train"


class EstimationRecord(msgspec.Struct, frozen=True):
    """The estimate after one more batch of estimation rollouts.

    iteration: number of the batch stream
    rollouts: estimation rollouts so far
    p: estimate of the probability
    std_error: its standard error
    low: lower end of its interval
    high: upper end of its interval
    ess: effective number of events
    max_weight_share: the largest event's weight over the sum of the events' weights
    events: estimation rollouts with f <= gamma
    failed: estimation rollouts with f = NaN
    phase: "estimate"
    """

    iteration: int
    rollouts: int
    p: float
    std_error: float
    low: float
    high: float
    ess: float
    max_weight_share: float
    events: int
    failed: int
    phase: str = "estimate"
