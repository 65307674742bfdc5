"""What Algorithm 1 and mixture sampling share: after a search of any kind, a fresh sample of one proposal."""

import math
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from ce.naive import record_of
from ce.posed import Posed
from ce.product import Product
from ce.results import SAMPLING_SHARE, Condition, Estimate, FailedRollout
from ce.state import EstimationRecord
from ce.stopping import counted, next_look, spending

Array = NDArray[np.float64]


class ImportanceSampling(Posed):
    """States have phase, records, failed, f, log_weights, base_f, look_at, trial and looks."""

    def _estimation_limit(self, state: Any) -> int:
        """Rollouts that the fresh sample may have."""
        raise NotImplementedError

    def _sampled(self, state: Any) -> Product:
        """The proposal of the fresh sample, or the member of the family nearest to it."""
        raise NotImplementedError

    def _search_conditions(self, state: Any) -> list[Condition]:
        raise NotImplementedError

    def estimate(self, state: Any) -> Estimate:
        """The estimate so far; p is NaN until estimation rollouts have been answered."""
        search = sum(record.rollouts for record in state.records)
        first = counted(state.f.size, state.look_at, state.trial)
        failures = [FailedRollout("train", k, i) for k, i in state.failed]
        failures += [FailedRollout("estimate", 0, int(i)) for i in np.flatnonzero(np.isnan(state.f))]
        return Estimate(
            gamma=self.gamma,
            method=self.method,
            confidence=self.options.confidence,
            rollouts=search + state.f.size,
            training_rollouts=search + first,
            f=state.f[first:],
            log_weights=state.log_weights[first:],
            proposal=self._sampled(state),
            finished=state.phase == "done",
            rel_error=self.options.rel_error,
            failed_rollouts=tuple(failures),
            search_warnings=tuple(self._search_conditions(state)),
            base_f=state.base_f,
            spending=spending(state.looks, state.phase == "done") if first else 1.0,
            sampling_share=SAMPLING_SHARE,
            **self._extra(state),
        )

    def _extra(self, state: Any) -> dict[str, Any]:
        return {}

    def _estimation_step(self, state: Any, f: Array, log_w: Array) -> tuple[Any, EstimationRecord]:
        """The state after a batch of the fresh sample with log weights log_w (n,), and where the estimate stands."""
        after = msgspec.structs.replace(
            state, f=np.concatenate([state.f, f]), log_weights=np.concatenate([state.log_weights, log_w])
        )
        est = self.estimate(after)
        if after.f.size >= state.look_at:
            plan = next_look(est, after.f.size, self._estimation_limit(state), state.trial, state.looks)
            after = msgspec.structs.replace(
                after,
                look_at=plan.look_at,
                trial=plan.trial,
                looks=plan.looks,
                phase="done" if plan.done else "estimate",
            )
        return after, record_of(est)


def starved_condition(records: tuple[Any, ...]) -> Condition | None:
    """Where fewer than rho N values were finite in an iteration of a search."""
    starved = [r.iteration for r in records if not r.quantile < math.inf and "look" not in r.summary]
    if not starved:
        return None
    return Condition(
        "quantile-infinite",
        f"in {len(starved)} iterations (first: {starved[0]}) fewer than rho N rollouts had a finite f: the search went "
        "by the few finite ones",
        "more samples an iteration, a larger rho, or a measure f that is finite more often",
    )
