"""Naive Monte Carlo behind the ask-and-tell interface.

p = (1/n) sum 1{f(X_i) <= gamma}, X_i iid from P0 (paper, section 2).
"""

from dataclasses import dataclass

import msgspec
import numpy as np
from numpy.typing import ArrayLike

from ce.checks import at_least, budget_is_an_integer, checked_response, checked_turn, precision_in_range
from ce.errors import BudgetError
from ce.estimator import Estimator
from ce.product import Product
from ce.records import Batch, EstimationRecord
from ce.results import Estimate, FailedRollout
from ce.state import NaiveState
from ce.stopping import first_interim, left_out, next_interim, spending
from ce.streams import draw

LEAST_BUDGET = 1


@dataclass(frozen=True)
class NaiveOptions:
    """Options of naive Monte Carlo.

    budget: rollouts at most
    rel_error: relative half-width of the interval to stop at (None: spend the budget)
    confidence: of the interval, in (0, 1)
    batch_size: rollouts in a batch
    """

    budget: int = 100_000
    rel_error: float | None = None
    confidence: float = 0.95
    batch_size: int = 5000

    def __post_init__(self) -> None:
        budget_is_an_integer(self.budget)
        if self.budget < LEAST_BUDGET:
            raise BudgetError(f"budget must be at least {LEAST_BUDGET} rollout, not {self.budget}")
        at_least("batch_size", self.batch_size, 1)
        precision_in_range(self.rel_error, self.confidence)

    def held_rows(self, dim: int) -> int:
        """Rows of `dim` numbers that a state and its open batch hold together at most."""
        return min(self.batch_size, self.budget)


@dataclass(frozen=True)
class Naive(Estimator[NaiveState], method="naive", state_type=NaiveState):
    """Naive Monte Carlo as pure functions of a frozen `NaiveState`."""

    options: NaiveOptions = NaiveOptions()

    def _initial(self, seed: int) -> NaiveState:
        o = self.options
        interim_at = first_interim(o.rel_error, o.budget, o.batch_size)
        return NaiveState(self.digest, seed, np.zeros(0), interim_at, False)

    def propose(self, state: NaiveState) -> Batch | None:
        """The next batch, None when finished."""
        if state.done:
            return None
        start = state.f.size
        stop = min(start + self.options.batch_size, state.interim_at)
        x, noise = draw(self.base, state.seed, "estimate", 0, start, stop)
        return Batch("estimate", 0, x, noise, self.base.parameters(), state.seed, start, stop)

    def update(self, state: NaiveState, batch: Batch, f: ArrayLike) -> tuple[NaiveState, EstimationRecord]:
        """The state after the batch was answered with f (n,), and a record of where the estimate stands."""
        checked_turn(batch, state.seed, "estimate", 0, state.f.size)
        joined = np.concatenate([state.f, checked_response(batch, f)])
        after = msgspec.structs.replace(state, f=joined)
        est = self.estimate(after)
        if joined.size >= state.interim_at:
            plan = next_interim(est, joined.size, self.options.budget, state.trial, state.interim_looks)
            after = msgspec.structs.replace(
                after,
                interim_at=plan.interim_at,
                trial=plan.trial,
                interim_looks=plan.interim_looks,
                done=plan.done,
            )
        return after, record_of(est)

    def estimate(self, state: NaiveState) -> Estimate:
        """The estimate so far; p is NaN before the first batch."""
        first = left_out(state.f.size, state.interim_at, state.trial)
        return Estimate(
            gamma=self.gamma,
            method="naive",
            confidence=self.options.confidence,
            rollouts=state.f.size,
            training_rollouts=first,
            f=state.f[first:],
            log_weights=None,
            proposal=self.base,
            finished=state.done,
            rel_error=self.options.rel_error,
            seed=state.seed,
            failed_rollouts=tuple(
                FailedRollout("estimate", 0, int(i)) for i in np.flatnonzero(np.isnan(state.f))
            ),
            spending=spending(state.interim_looks, state.done) if first else 1.0,
        )

    def proposal(self, state: NaiveState) -> Product:
        """The distribution being sampled: the base."""
        return self.base


def record_of(est: Estimate) -> EstimationRecord:
    """Where an estimate stands, as a flat record."""
    low, high = est.ci
    return EstimationRecord(
        iteration=0,
        rollouts=est.estimation_rollouts,
        p=est.p,
        std_error=est.std_error,
        low=low,
        high=high,
        ess=est.ess,
        max_weight_share=est.max_weight_share,
        events=est.events,
        failed=int(np.count_nonzero(np.isnan(est.f))),
    )
