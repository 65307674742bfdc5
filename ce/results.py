"""What an algorithm reports: the estimate, its interval, its warnings, and data for plots."""

import functools
import math
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import ndtri

from ce.estimate_warnings import (
    ABOUT_THE_ESTIMATE,
    DOMINANT_SHARE,
    ENOUGH_EVENTS,
    FEW_EVENTS,
    HEAVY_TAIL,
    EstimateWarning,
    warnings_of,
)
from ce.interval import EventSums, clopper_pearson, counted_interval, weighted_interval
from ce.pareto import pareto_k
from ce.product import Product

Array = NDArray[np.float64]

# Of 1 - confidence, where an interval takes a proposal's or a move's quality on trust (README, "Intervals").
SAMPLING_SHARE = 0.6


@dataclass(frozen=True)
class FailedRollout:
    """A rollout whose f was NaN.

    phase: "train" or "estimate"
    iteration: of the batch stream (phase, iteration)
    index: its row in that stream
    """

    phase: str
    iteration: int
    index: int


@dataclass(frozen=True)
class Curve:
    """p for many thresholds from the same rollouts, with pointwise intervals; all arrays (m,).

    gammas: thresholds, in the unit of f
    p: estimate at each
    std_error: its standard error
    low: lower end of its interval
    high: upper end of its interval
    events: estimation rollouts with f <= gamma
    ess: effective number of events
    pareto_k: of the events' weights; NaN for naive Monte Carlo and for fewer than 25 events
    """

    gammas: Array
    p: Array
    std_error: Array
    low: Array
    high: Array
    events: NDArray[np.int64]
    ess: Array
    pareto_k: Array

    @classmethod
    def unknown(cls, gammas: Array) -> "Curve":
        """Where nothing is known yet: intervals from 0 to 1."""
        m = gammas.size
        nan = np.full(m, math.nan)
        return cls(gammas, nan, nan, np.zeros(m), np.ones(m), np.zeros(m, dtype=np.int64), np.zeros(m), nan)


@dataclass(frozen=True)
class Trace:
    """The estimate after each of some numbers of estimation rollouts; all arrays (m,).

    rollouts: the numbers
    p: estimate after each
    std_error: its standard error
    low: lower end of its interval
    high: upper end of its interval
    """

    rollouts: NDArray[np.int64]
    p: Array
    std_error: Array
    low: Array
    high: Array


@dataclass(frozen=True)
class Estimate:
    """Estimate of p = P0(f(X) <= gamma), made by an algorithm's `estimate(state)`.

    p = (1/n) sum w_i 1{f_i <= gamma}, a failed rollout counting as no event; std_error is the sample standard
    deviation of the terms / sqrt(n). ci: Clopper-Pearson (naive) or the weighted gamma interval; its lower
    end counts failed rollouts as no events, its upper end counts them as events with their weights. Where
    there is no event, or one event weighs more than DOMINANT_SHARE, or Pareto k exceeds HEAVY_TAIL with
    fewer than ENOUGH_EVENTS effective events, the interval is widened to hold the Clopper-Pearson interval
    of base_f.

    gamma: threshold of the event, in the unit of f
    method: that made the estimate
    confidence: of the interval, in (0, 1)
    rollouts: calls of f, training included
    training_rollouts: those spent on the search
    f: (n,), values of the estimation rollouts, NaN = failed
    log_weights: (n,), log p0 / p_theta; None for naive Monte Carlo
    proposal: that was sampled, or the member of the base's family nearest to it
    finished: whether the algorithm has nothing more to propose
    rel_error: relative half-width that was asked for, None for none
    failed_rollouts: all of them, training included
    search_warnings: what the search has to say of itself
    base_f: (k,), f of the search's own rollouts from the base (its first iteration)
    seed: of naive Monte Carlo, whose draws it decides
    spending: share of 1 - confidence that the interval may miss, where a run may stop at several interim looks
    sampling_share: of 1 - confidence, left to the error of sampling (README, "Intervals")
    mode_coverage: share of the event, as a mode search met it, that the proposal covers; NaN without a mode search

    >>> import ce
    >>> base = ce.Product([ce.Normal([0.0, 0.0], [[1.0, 0.0], [0.0, 1.0]])])
    >>> est = ce.estimate(lambda x: 3.0 - x[:, 0], base, gamma=0.0, budget=10_000, seed=1)
    >>> est.method, est.rollouts, est.training_rollouts, est.converged
    ('mixture', 10000, 6000, True)
    >>> abs(est.p / 0.0013499 - 1.0) < 0.05, est.ci[0] < 0.0013499 < est.ci[1], est.warnings
    (True, True, ())
    """

    gamma: float
    method: str
    confidence: float
    rollouts: int
    training_rollouts: int
    f: Array = field(repr=False)
    log_weights: Array | None = field(repr=False)
    proposal: Product = field(repr=False)
    finished: bool = False
    rel_error: float | None = None
    failed_rollouts: tuple[FailedRollout, ...] = field(default=(), repr=False)
    search_warnings: tuple[EstimateWarning, ...] = ()
    base_f: Array = field(default_factory=lambda: np.zeros(0), repr=False)
    seed: int | None = None
    spending: float = 1.0
    sampling_share: float = 1.0
    mode_coverage: float = math.nan

    def __str__(self) -> str:
        low, high = self.ci
        named = f"; {', '.join(w.name for w in self.warnings)}" if self.warnings else ""
        return (
            f"p = {self.p:.4g} +- {self.std_error:.2g}, {self.confidence:.0%} interval "
            f"[{low:.4g}, {high:.4g}], {self.method}, {self.rollouts} rollouts{named}"
        )

    # -- the estimate ----------------------------------------------------------------------------------------

    @property
    def _interval_confidence(self) -> float:
        """Confidence of the interval by itself, at this interim look and with what is left to sampling."""
        return 1.0 - (1.0 - self.confidence) * self.spending * self.sampling_share

    @property
    def estimation_rollouts(self) -> int:
        """Calls of f that are not training."""
        return self.rollouts - self.training_rollouts

    @functools.cached_property
    def _at_gamma(self) -> Curve:
        return self.curve([self.gamma])

    @property
    def p(self) -> float:
        """Estimate of the probability; NaN before the first estimation rollout."""
        return float(self._at_gamma.p[0])

    @property
    def std_error(self) -> float:
        """Standard error of p."""
        return float(self._at_gamma.std_error[0])

    @property
    def ci(self) -> tuple[float, float]:
        """Lower and upper end of the interval for p."""
        return float(self._at_gamma.low[0]), float(self._at_gamma.high[0])

    @property
    def events(self) -> int:
        """Number of estimation rollouts with f <= gamma."""
        return int(self._at_gamma.events[0])

    @property
    def ess(self) -> float:
        """Effective number of events, (sum w)^2 / sum w^2 over the events only, which is their number for naive."""
        return float(self._at_gamma.ess[0])

    @functools.cached_property
    def max_weight_share(self) -> float:
        """The largest event's weight over the sum of the events' weights, 0 without events."""
        w = self._below(self.gamma)[1]
        return float(w.max() / w.sum()) if w.size else 0.0

    @property
    def pareto_k(self) -> float:
        """Tail index of the events' weights; NaN for naive Monte Carlo and for fewer than 25 events."""
        return float(self._at_gamma.pareto_k[0])

    @property
    def failed(self) -> int:
        """Number of failed rollouts, training included; `failed_rollouts` lists them."""
        return len(self.failed_rollouts)

    @property
    def relative_half_width(self) -> float:
        """z std_error / p; infinite without events."""
        z = float(ndtri(0.5 + 0.5 * self._interval_confidence))
        return z * self.std_error / self.p if self.p > 0 else math.inf

    @property
    def efficiency(self) -> float:
        """(p (1 - p) / rollouts) / std_error^2, NaN without events.

        It is the variance of naive Monte Carlo with as many rollouts, training counted, over this estimate's own
        variance estimate.
        """
        if not self.p > 0 or not self.std_error > 0:
            return math.nan
        return self.p * (1.0 - self.p) / self.rollouts / self.std_error**2

    @property
    def converged(self) -> bool:
        """Whether the target precision was reached; without a target, finished and no warning about the estimate."""
        if self.rel_error is not None:
            return self.ess >= FEW_EVENTS and self.relative_half_width <= self.rel_error
        return self.finished and not any(w.name in ABOUT_THE_ESTIMATE for w in self.warnings)

    @functools.cached_property
    def warnings(self) -> tuple[EstimateWarning, ...]:
        """What bears on how far the estimate can be relied on; see README.md, "Warnings"."""
        return (*self.search_warnings, *warnings_of(self))

    # -- many thresholds, many prefixes ----------------------------------------------------------------------

    @functools.cached_property
    def _weights(self) -> Array:
        return np.ones(self.f.size) if self.log_weights is None else np.exp(self.log_weights)

    def _below(self, limit: float) -> tuple[Array, Array]:
        """f <= limit ascending, and the weights beside it.

        Ties in f are ordered by weight, so that sums do not depend on the order of the rollouts.
        """
        below = self.f <= limit
        f, w = self.f[below], self._weights[below]
        order = np.lexsort((w, f))
        return f[order], w[order]

    def curve(self, gammas: ArrayLike) -> Curve:
        """p, standard error and pointwise interval at each threshold (m,), from the same rollouts.

        An importance-sampling proposal was made for `gamma`; thresholds far from it have wide, still
        honest, intervals.

        >>> import ce
        >>> base = ce.Product([ce.Normal([0.0], [[1.0]])])
        >>> est = ce.estimate(lambda x: 2.0 - x[:, 0], base, gamma=0.0, method="naive", budget=5000, seed=1)
        >>> curve = est.curve([0.0, 0.5, 1.0])
        >>> curve.p.round(4).tolist(), curve.events.tolist()
        ([0.0252, 0.0716, 0.1674], [126, 358, 837])
        """
        gammas = np.atleast_1d(np.asarray(gammas, dtype=np.float64))
        f, w = self._below(np.max(gammas, initial=-math.inf))
        counts = np.searchsorted(f, gammas, side="right").astype(np.int64)
        sums = EventSums(
            n=self.f.size,
            counts=counts.astype(np.float64),
            sums=np.array([w[:k].sum() for k in counts]),
            squares=np.array([np.sum(w[:k] ** 2) for k in counts]),
            largest=np.array([w[:k].max() if k else 0.0 for k in counts]),
            failed=np.sort(self._weights[np.isnan(self.f)]),
            largest_of_any=float(np.max(self._weights, initial=1.0)),
        )
        k = np.array([math.nan if self.log_weights is None else pareto_k(w[:k]) for k in counts])
        p, std_error, low, high = self._interval(sums, gammas, k)
        some = sums.squares > 0
        ess = np.where(some, sums.sums**2 / np.where(some, sums.squares, 1.0), 0.0)
        return Curve(gammas, p, std_error, low, high, counts, ess, k)

    def simultaneous_curve(self, gammas: ArrayLike) -> Curve:
        """As `curve`, with intervals that hold at all m thresholds together (Bonferroni).

        >>> import ce
        >>> base = ce.Product([ce.Normal([0.0], [[1.0]])])
        >>> est = ce.estimate(lambda x: 2.0 - x[:, 0], base, gamma=0.0, method="naive", budget=5000, seed=1)
        >>> bool(est.simultaneous_curve([0.0, 0.5]).high[0] > est.curve([0.0, 0.5]).high[0])
        True
        """
        m = max(np.size(gammas), 1)
        return replace(self, confidence=1.0 - (1.0 - self.confidence) / m).curve(gammas)

    def trace(self, points: int = 100) -> Trace:
        """The estimate at gamma after about `points` log-spaced numbers of estimation rollouts, and after all."""
        n = self.f.size
        if n == 0:
            empty = np.zeros(0)
            return Trace(np.zeros(0, dtype=np.int64), empty, empty, empty, empty)
        at = np.unique(np.geomspace(min(10, n), n, points).round().astype(np.int64))
        w = self._weights
        event = np.where(self.f <= self.gamma, w, 0.0)
        any_weight = np.maximum.accumulate(np.maximum(w, 1.0))
        failed = np.where(np.isnan(self.f), w, 0.0)
        gamma, tail = np.array([self.gamma]), np.array([self.pareto_k])
        parts = [
            self._interval(
                EventSums(
                    n=int(k),
                    counts=np.array([np.count_nonzero(event[:k])], dtype=np.float64),
                    sums=np.array([event[:k].sum()]),
                    squares=np.array([np.sum(event[:k] ** 2)]),
                    largest=np.array([event[:k].max()]),
                    failed=failed[:k][failed[:k] > 0],
                    largest_of_any=float(any_weight[k - 1]),
                ),
                gamma,
                tail,
            )
            for k in at
        ]
        columns = [np.concatenate([part[j] for part in parts]) for j in range(4)]
        return Trace(at, *columns)

    @functools.cached_property
    def _sorted_base_f(self) -> Array:
        return np.sort(self.base_f[~np.isnan(self.base_f)])

    def _interval(self, of: EventSums, gammas: Array, tail: Array) -> tuple[Array, Array, Array, Array]:
        """p, standard error, lower and upper end, each (m,).

        of: sums over the events at m thresholds
        gammas: (m,), the thresholds
        tail: (m,), Pareto k of the events' weights
        """
        if of.n == 0:
            nan = np.full(gammas.shape, np.nan)
            return nan, nan, np.zeros(gammas.shape), np.ones(gammas.shape)
        confidence = self._interval_confidence
        if self.log_weights is None:
            return of.p, *counted_interval(of, confidence)
        std_error, low, high = weighted_interval(of, confidence)
        unreliable = (
            (of.counts == 0)
            | (of.largest > DOMINANT_SHARE * of.sums)
            | ((tail > HEAVY_TAIL) & (of.sums**2 < ENOUGH_EVENTS * of.squares))
        )
        if self.base_f.size and np.any(unreliable):
            k = np.searchsorted(self._sorted_base_f, gammas, side="right")
            k_failed = self.base_f.size - self._sorted_base_f.size
            base_low, _ = clopper_pearson(k, self.base_f.size, confidence)
            _, base_high = clopper_pearson(k + k_failed, self.base_f.size, confidence)
            low = np.where(unreliable, np.minimum(low, base_low), low)
            high = np.where(unreliable, np.maximum(high, base_high), high)
        return of.p, std_error, low, high


def variance_ratio(reference: Estimate, other: Estimate) -> float:
    """std_error^2 of `reference` over that of `other`: above 1 where `other` is the more precise, whatever its cost.

    >>> import ce
    >>> base = ce.Product([ce.Normal([0.0], [[1.0]])])
    >>> few, many = (
    ...     ce.estimate(lambda x: 1.0 - x[:, 0], base, 0.0, "naive", budget=n) for n in (1000, 100_000)
    ... )
    >>> 80.0 < ce.variance_ratio(few, many) < 120.0
    True
    """
    return (reference.std_error / other.std_error) ** 2 if other.std_error > 0 else math.nan
