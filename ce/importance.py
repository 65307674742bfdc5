"""What Algorithm 1 and mixture sampling share: after a search of any kind, a fresh sample of one proposal."""

import math
from collections.abc import Sequence
from typing import TypeVar

import msgspec
import numpy as np
from numpy.typing import NDArray

from ce.estimate_warnings import EstimateWarning
from ce.estimator import Estimator
from ce.naive import record_of
from ce.product import Product
from ce.records import EstimationRecord, TrainingRecord
from ce.results import SAMPLING_SHARE, Estimate, FailedRollout
from ce.state import SearchedState
from ce.stopping import left_out, next_interim, spending

Array = NDArray[np.float64]
S = TypeVar("S", bound=SearchedState)


class ImportanceSampling(Estimator[S]):
    """The estimate from the fresh sample; the searches derive from it."""

    def _estimation_limit(self, state: S) -> int:
        """Rollouts that the fresh sample may have."""
        raise NotImplementedError

    def _sampled(self, state: S) -> Product:
        """The proposal of the fresh sample, or the member of the family nearest to it."""
        raise NotImplementedError

    def _search_warnings(self, state: S) -> list[EstimateWarning]:
        """What is to be said of the search."""
        raise NotImplementedError

    def _mode_coverage(self, state: S) -> float:
        """As `Estimate.mode_coverage`."""
        return math.nan

    def estimate(self, state: S) -> Estimate:
        """The estimate so far; p is NaN until estimation rollouts have been answered."""
        sample = state.sample
        search = sum(record.rollouts for record in state.records)
        first = left_out(sample.f.size, sample.interim_at, sample.trial)
        failures = [FailedRollout("train", k, i) for k, i in state.failed]
        failures += [FailedRollout("estimate", 0, int(i)) for i in np.flatnonzero(np.isnan(sample.f))]
        done = state.phase == "done"
        return Estimate(
            gamma=self.gamma,
            method=self.method,
            confidence=self.options.confidence,
            rollouts=search + sample.f.size,
            training_rollouts=search + first,
            f=sample.f[first:],
            log_weights=sample.log_weights[first:],
            proposal=self._sampled(state),
            finished=done,
            rel_error=self.options.rel_error,
            failed_rollouts=tuple(failures),
            search_warnings=tuple(self._search_warnings(state)),
            base_f=state.base_f,
            spending=spending(sample.interim_looks, done) if first else 1.0,
            sampling_share=SAMPLING_SHARE,
            mode_coverage=self._mode_coverage(state),
        )

    def _estimation_step(self, state: S, f: Array, log_w: Array) -> tuple[S, EstimationRecord]:
        """The state after a batch of the fresh sample with log weights log_w (n,), and where the estimate stands."""
        sample = msgspec.structs.replace(
            state.sample,
            f=np.concatenate([state.sample.f, f]),
            log_weights=np.concatenate([state.sample.log_weights, log_w]),
        )
        after = msgspec.structs.replace(state, sample=sample)
        est = self.estimate(after)
        n = sample.f.size
        if n >= sample.interim_at:
            plan = next_interim(est, n, self._estimation_limit(state), sample.trial, sample.interim_looks)
            sample = msgspec.structs.replace(
                sample, interim_at=plan.interim_at, trial=plan.trial, interim_looks=plan.interim_looks
            )
            phase = "done" if plan.done else "estimate"
            after = msgspec.structs.replace(after, phase=phase, sample=sample)
        return after, record_of(est)


def failed_rows(iteration: int, f: Array) -> tuple[tuple[int, int], ...]:
    """(iteration, row) of each f (n,) that is NaN."""
    return tuple((iteration, int(i)) for i in np.flatnonzero(np.isnan(f)))


def of_fits(records: Sequence[TrainingRecord]) -> list[TrainingRecord]:
    """The records of batches of the search itself, those of a mode search left out."""
    return [r for r in records if "mode_search" not in r.summary]


def starved_warning(records: Sequence[TrainingRecord]) -> EstimateWarning | None:
    """Where fewer than rho N values were finite in an iteration of a search."""
    starved = [r.iteration for r in of_fits(records) if not r.quantile < math.inf]
    if not starved:
        return None
    return EstimateWarning(
        "quantile-infinite",
        f"in {len(starved)} iterations (first: {starved[0]}) fewer than rho N rollouts had a finite f: the search went "
        "by the few finite ones",
        "more samples an iteration, a larger rho, or a measure f that is finite more often",
    )
