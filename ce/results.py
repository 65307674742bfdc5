"""What an algorithm reports: the estimate, its interval, its warnings, and data for plots."""

import functools
import math
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import ndtri

from ce.interval import clopper_pearson, weighted_gamma
from ce.pareto import pareto_k
from ce.product import Product

Array = NDArray[np.float64]

FEW_EVENTS = 30.0  # effective events below which an importance-sampling standard error is not to be relied on
HEAVY_TAIL = 0.7  # Pareto k of many events' weights above which the estimate is not to be relied on
ENOUGH_EVENTS = 300.0  # effective events from which a heavy tail alone no longer widens the interval
SAMPLING_SHARE = (
    0.6  # of 1 - confidence, where an interval takes a proposal's or a move's quality on trust (README)
)
DOMINANT_SHARE = 0.1  # share of one event's weight in the estimate above which it is said so


def heaviest_tail(ess: float) -> float:
    """Pareto k of the weights of events worth `ess` above which the estimate is not to be relied on (Vehtari, Simpson,
    Gelman, Yao and Gabry, JMLR 25, 2024, for a sample of that size): 0.5 for 100, HEAVY_TAIL from 2,200 on."""
    return min(1.0 - 1.0 / math.log10(ess), HEAVY_TAIL) if ess > 10.0 else 0.0


@dataclass(frozen=True)
class Condition:
    """A named condition that bears on how far the estimate can be relied on."""

    name: str
    message: str
    remedy: str


@dataclass(frozen=True)
class FailedRollout:
    """A rollout whose f was NaN: row `index` of the batch stream (phase, iteration)."""

    phase: str
    iteration: int
    index: int


@dataclass(frozen=True)
class Curve:
    """p for many thresholds from the same rollouts. All arrays (m,); the intervals are pointwise."""

    gammas: Array
    p: Array
    std_error: Array
    low: Array
    high: Array
    events: NDArray[np.int64]
    ess: Array
    pareto_k: Array  # of the events' weights; NaN for naive Monte Carlo and for fewer than 25 events


@dataclass(frozen=True)
class Trace:
    """The estimate after each of some numbers of estimation rollouts. All arrays (m,)."""

    rollouts: NDArray[np.int64]
    p: Array
    std_error: Array
    low: Array
    high: Array


@dataclass(frozen=True)
class Estimate:
    """Estimate of p = P0(f(X) <= gamma). Made by an algorithm's `estimate(state)`.

    f: (n,) values of the estimation rollouts, NaN = failed; log_weights: (n,) log p0/p_theta, None for
    naive Monte Carlo. rollouts counts every call of f, training_rollouts those spent on the search.
    finished: the algorithm has nothing more to propose.

    p = (1/n) sum w_i 1{f_i <= gamma}, a failed rollout counting as no event; std_error is the sample standard
    deviation of the terms / sqrt(n). ci: Clopper-Pearson (naive) or the weighted gamma interval; its lower
    end counts failed rollouts as no events, its upper end counts them as events with their weights. Where
    there is no event, or one event weighs more than DOMINANT_SHARE, or Pareto k exceeds HEAVY_TAIL with
    fewer than ENOUGH_EVENTS effective events, the interval is widened to hold the Clopper-Pearson interval
    of base_f, the search's own rollouts from the base (its first iteration).

    ess: effective number of events, (sum w)^2 / sum w^2 over the events only (naive: the number of events).
    max_weight_share: the largest event's weight over the sum of the events' weights.
    converged: the target precision was reached; without a target, finished and no warning about the estimate.
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
    search_warnings: tuple[Condition, ...] = ()
    base_f: Array = field(default_factory=lambda: np.zeros(0), repr=False)
    seed: int | None = None  # of naive Monte Carlo, whose draws it decides
    spending: float = (
        1.0  # share of 1 - confidence that the interval may miss, where a run may stop at several looks
    )
    sampling_share: float = 1.0  # of 1 - confidence, left to the error of sampling (README, "Intervals")
    mode_coverage: float = (
        math.nan
    )  # share of the event as looked for apart that the proposal covers; NaN: no look

    def __str__(self) -> str:
        low, high = self.ci
        named = f"; {', '.join(w.name for w in self.warnings)}" if self.warnings else ""
        return (
            f"p = {self.p:.4g} +- {self.std_error:.2g}, {self.confidence:.0%} interval "
            f"[{low:.4g}, {high:.4g}], {self.method}, {self.rollouts} rollouts{named}"
        )

    # -- the estimate ----------------------------------------------------------------------------------------

    @property
    def _sure(self) -> float:
        """Confidence of this look's interval by itself."""
        return 1.0 - (1.0 - self.confidence) * self.spending * self.sampling_share

    @property
    def estimation_rollouts(self) -> int:
        return self.rollouts - self.training_rollouts

    @functools.cached_property
    def _at_gamma(self) -> Curve:
        return self.curve([self.gamma])

    @property
    def p(self) -> float:
        return float(self._at_gamma.p[0])

    @property
    def std_error(self) -> float:
        return float(self._at_gamma.std_error[0])

    @property
    def ci(self) -> tuple[float, float]:
        return float(self._at_gamma.low[0]), float(self._at_gamma.high[0])

    @property
    def events(self) -> int:
        """Number of estimation rollouts with f <= gamma."""
        return int(self._at_gamma.events[0])

    @property
    def ess(self) -> float:
        return float(self._at_gamma.ess[0])

    @functools.cached_property
    def max_weight_share(self) -> float:
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
        z = float(ndtri(0.5 + 0.5 * self._sure))
        return z * self.std_error / self.p if self.p > 0 else math.inf

    @property
    def efficiency(self) -> float:
        """(p (1 - p) / rollouts) / std_error^2: variance of naive Monte Carlo with as many rollouts,
        training counted, over this estimate's own variance estimate. NaN without events."""
        if not self.p > 0 or not self.std_error > 0:
            return math.nan
        return self.p * (1.0 - self.p) / self.rollouts / self.std_error**2

    @property
    def converged(self) -> bool:
        if self.rel_error is not None:
            return self.ess >= FEW_EVENTS and self.relative_half_width <= self.rel_error
        return self.finished and not any(w.name in _UNSETTLED for w in self.warnings)

    @functools.cached_property
    def warnings(self) -> tuple[Condition, ...]:
        """Conditions that hold; see README.md, "Warnings"."""
        return (*self.search_warnings, *_conditions(self))

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
        """
        gammas = np.atleast_1d(np.asarray(gammas, dtype=np.float64))
        f, w = self._below(np.max(gammas, initial=-math.inf))
        w_failed = np.sort(self._weights[np.isnan(self.f)])
        counts = np.searchsorted(f, gammas, side="right").astype(np.int64)
        sums = np.array([w[:k].sum() for k in counts])
        squares = np.array([np.sum(w[:k] ** 2) for k in counts])
        largest = np.array([w[:k].max() if k else 0.0 for k in counts])
        k = np.array([math.nan if self.log_weights is None else pareto_k(w[:k]) for k in counts])
        p, std_error, low, high = self._interval(
            self.f.size,
            counts,
            sums,
            squares,
            largest,
            w_failed,
            np.max(self._weights, initial=1.0),
            gammas,
            k,
        )
        ess = np.where(squares > 0, sums**2 / np.where(squares > 0, squares, 1.0), 0.0)
        return Curve(gammas, p, std_error, low, high, counts, ess, k)

    def simultaneous_curve(self, gammas: ArrayLike) -> Curve:
        """As `curve`, with intervals that hold at all m thresholds together (Bonferroni)."""
        m = max(np.size(gammas), 1)
        return replace(self, confidence=1.0 - (1.0 - self.confidence) / m).curve(gammas)

    def trace(self, points: int = 100) -> Trace:
        """The estimate at gamma after about `points` log-spaced numbers of estimation rollouts, and after
        all.
        """
        n = self.f.size
        if n == 0:
            empty = np.zeros(0)
            return Trace(np.zeros(0, dtype=np.int64), empty, empty, empty, empty)
        at = np.unique(np.geomspace(min(10, n), n, points).round().astype(np.int64))
        w = self._weights
        event = np.where(self.f <= self.gamma, w, 0.0)
        any_weight = np.maximum.accumulate(np.maximum(w, 1.0))
        failed = np.where(np.isnan(self.f), w, 0.0)
        parts = [
            self._interval(
                int(k),
                np.count_nonzero(event[:k]),
                event[:k].sum(),
                np.sum(event[:k] ** 2),
                event[:k].max(),
                failed[:k][failed[:k] > 0],
                any_weight[k - 1],
                self.gamma,
                self.pareto_k,
            )
            for k in at
        ]
        columns = [np.array([float(part[j]) for part in parts]) for j in range(4)]
        return Trace(at, *columns)

    @functools.cached_property
    def _sorted_base_f(self) -> Array:
        return np.sort(self.base_f[~np.isnan(self.base_f)])

    def _interval(self, n, counts, sums, squares, largest, w_failed, any_largest, gammas, tail):
        """p, standard error, low, high from n terms: sums of event weights, of their squares, the largest
        event weight, the failures' weights and the largest weight of any rollout (at least 1, as E[w] =
        1)."""
        counts, sums, squares, largest = (
            np.asarray(a, dtype=np.float64) for a in (counts, sums, squares, largest)
        )
        if n == 0:
            nan = np.full(sums.shape, np.nan)
            return nan, nan, np.zeros(sums.shape), np.ones(sums.shape)
        p = np.minimum(sums / n, 1.0)  # weights of a certain event may sum to a little more
        if self.log_weights is None:
            std_error = np.sqrt(p * (1.0 - p) / n)
            low, _ = clopper_pearson(counts, n, self._sure)
            _, high = clopper_pearson(counts + w_failed.size, n, self._sure)
            return p, std_error, low, high

        def variance(sums, squares):
            return np.maximum(squares / n - (sums / n) ** 2, 0.0) / max(n - 1, 1)

        std_error = np.sqrt(variance(sums, squares))
        low, _ = weighted_gamma(p, std_error**2, largest / n, self._sure)
        upper_sums, upper_squares = sums + w_failed.sum(), squares + np.sum(w_failed**2)
        upper_largest = np.maximum(largest, np.max(w_failed, initial=0.0))
        # No event at all: what one would weigh is unknown; the largest weight met stands in for it.
        upper_largest = np.where(upper_largest > 0, upper_largest, any_largest)
        _, high = weighted_gamma(
            upper_sums / n, variance(upper_sums, upper_squares), upper_largest / n, self._sure
        )
        shaky = (
            (counts == 0)
            | (largest > DOMINANT_SHARE * sums)
            | ((tail > HEAVY_TAIL) & (sums**2 < ENOUGH_EVENTS * squares))
        )
        if self.base_f.size and np.any(shaky):
            k = np.searchsorted(self._sorted_base_f, gammas, side="right")
            k_failed = self.base_f.size - self._sorted_base_f.size
            base_low, _ = clopper_pearson(k, self.base_f.size, self._sure)
            _, base_high = clopper_pearson(k + k_failed, self.base_f.size, self._sure)
            low = np.where(shaky, np.minimum(low, base_low), low)
            high = np.where(shaky, np.maximum(high, base_high), high)
        return p, std_error, low, high


def variance_ratio(reference: Estimate, other: Estimate) -> float:
    """std_error^2 of `reference` over that of `other`: > 1 where `other` is the more precise, whatever each
    has cost.
    """
    return (reference.std_error / other.std_error) ** 2 if other.std_error > 0 else math.nan


_UNSETTLED = frozenset(
    {"no-rollouts", "no-events", "few-events", "dominant-weight", "heavy-tailed-weights", "failed-rollouts"}
)


def _conditions(est: Estimate) -> list[Condition]:
    found: list[Condition] = []
    if est.f.size == 0:
        return [
            Condition(
                "no-rollouts",
                "no estimation rollout has been answered yet; p is not known",
                "go on proposing",
            )
        ]
    if est.events == 0:
        message = (
            f"none of {est.f.size} estimation rollouts had f <= {est.gamma:g}; the interval is an upper bound"
        )
        if est.log_weights is not None:
            message += " that takes the largest weight met for the weight an event would have"
        found.append(Condition("no-events", message, "raise the budget or gamma, or search longer"))
    elif est.ess < FEW_EVENTS:
        found.append(
            Condition(
                "few-events",
                f"{est.events} events, worth {est.ess:.1f} of equal weight (fewer than {FEW_EVENTS:g}): "
                "the standard error is itself uncertain",
                "raise the number of estimation rollouts; rely on the interval rather than on p +- std_error",
            )
        )
    if est.log_weights is not None and est.events > 0 and est.max_weight_share > DOMINANT_SHARE:
        found.append(
            Condition(
                "dominant-weight",
                f"one event carries {est.max_weight_share:.0%} of the estimate: the proposal misses "
                "part of the event",
                "constrain the search more (mean_box, beta_bounds), give it more samples, or use "
                "naive Monte Carlo",
            )
        )
    heaviest = heaviest_tail(est.ess)
    if est.pareto_k > heaviest:
        found.append(
            Condition(
                "heavy-tailed-weights",
                f"Pareto k of the events' weights is {est.pareto_k:.2f} (above {heaviest:.2f}): "
                "events of large weight "
                "are probably missing from the sample, so p tends to be too low and std_error too small",
                "limit the proposal (max_kl, mean_box), give the search more samples, or use naive "
                "Monte Carlo",
            )
        )
    if est.failed:
        in_estimate = int(np.count_nonzero(np.isnan(est.f)))
        found.append(
            Condition(
                "failed-rollouts",
                f"{est.failed} rollouts failed (f was NaN), {in_estimate} of them in the estimate: p "
                "counts those as no "
                "events, the upper end of the interval as events",
                "replay them from failed_rollouts and mend the cause",
            )
        )
    if not est.finished:
        found.append(Condition("unfinished", "rollouts are still to come", "go on proposing"))
    elif est.rel_error is not None and not est.converged:
        found.append(
            Condition(
                "precision-not-reached",
                f"relative half-width {est.relative_half_width:.3g}, asked for {est.rel_error:g}",
                "raise the budget",
            )
        )
    return found
