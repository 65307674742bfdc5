"""The main path: Algorithm 1 of the paper, and every other estimator, as one loop.

    state = init                                     theta_0 = the base distribution P0
    repeat:
        batch = propose(state)                       line 4: X_1 .. X_N ~ P_theta (and a noise seed for each)
        f     = run_batch(batch)                     the rollouts: SUMO, drivers, sensors, ego -> safety values
        state = update(state, batch, f)              lines 5 and 6: gamma_k, weights, theta_{k+1};
                                                     after the search: the running estimate of p
    until there is nothing left to propose
    estimate(state)                                  p = P0(f(X) <= gamma) with its interval

The search never calls the simulator. Whether `run_batch` is this process, a pool of local workers or a fleet is
decided by whoever calls `evaluate`; so is whether it remembers what it has run (`service.evaluation.store`), which is
all that resuming takes: the loop is deterministic, and batches that were run before are answered from the record.
"""

from collections.abc import Callable
from typing import Any

import numpy as np

import ce

RunBatch = Callable[[ce.Batch], np.ndarray]  # f of each row, (n,); NaN where the rollout failed
Observe = Callable[[Any, ce.TrainingRecord | ce.EstimationRecord], None]


def _look_away(state: Any, record: ce.TrainingRecord | ce.EstimationRecord) -> None:
    pass


def evaluate(
    algorithm: ce.Algorithm, seed: int, run_batch: RunBatch, observe: Observe = _look_away
) -> ce.Estimate:
    """Estimate p = P0(f(X) <= gamma) with `algorithm`; `observe` is shown each new state and its record."""
    state = algorithm.init(seed)
    while (batch := algorithm.propose(state)) is not None:
        f = run_batch(batch)
        state, record = algorithm.update(state, batch, f)
        observe(state, record)
    return algorithm.estimate(state)
