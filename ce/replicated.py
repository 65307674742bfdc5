"""Estimates whose precision comes from independent replications, not from independent rollouts."""

import functools
import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import chdtri, stdtrit

from ce.estimate_warnings import FEW_EVENTS, EstimateWarning
from ce.interval import clopper_pearson
from ce.results import Curve, Estimate, Trace

Array = NDArray[np.float64]

# Share of one replication in p above which it is said so.
DOMINANT_REPLICATION = 0.4
# p above which an interval holds that of a count, too.
MOSTLY_EVENTS = 0.9


@dataclass(frozen=True)
class ReplicatedEstimate(Estimate):
    """An estimate whose p is the mean over R replications, each a set of weighted values of f; otherwise as
    `Estimate`.

    std_error is that of the mean of R independent values, but not below what the spread of each level's own
    probability over the replications adds up to: a few skewed values often look more alike than they are, their
    factors less so. ci is Student's t on R - 1 degrees of freedom on the logarithm of p (delta method), because
    replications are skewed; without events, from 0 to what the last level reached leaves open. ess is (p /
    std_error)^2, the number of events that naive Monte Carlo would need for this precision; max_weight_share the
    largest replication's share of p.

    f: (n,), values
    log_weights: (n,), their log weights; the weights of a replication sum to one
    replication: (n,) int64, the number of each one's replication
    levels: (L,), fixed thresholds, falling, in the unit of f
    """

    replication: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, dtype=np.int64), repr=False)
    levels: Array = field(default_factory=lambda: np.zeros(0), repr=False)

    @functools.cached_property
    def _replications(self) -> int:
        return int(self.replication.max()) + 1 if self.replication.size else 0

    def _values(self, gammas: Array) -> tuple[Array, NDArray[np.int64]]:
        """p of each replication at each threshold (R, m), and the events behind them (m,)."""
        order = np.argsort(self.f)
        f, w, run = self.f[order], self._weights[order], self.replication[order]
        counts = np.searchsorted(f[: np.count_nonzero(~np.isnan(f))], gammas, side="right").astype(np.int64)
        values = np.array([np.bincount(run[:k], w[:k], minlength=self._replications) for k in counts])
        return values.reshape(gammas.size, -1).T, counts

    @functools.cached_property
    def max_weight_share(self) -> float:
        """The largest replication's share of p, 0 without events."""
        values = self._values(np.array([self.gamma]))[0][:, 0]
        return float(values.max() / values.sum()) if values.size and values.sum() > 0 else 0.0

    @property
    def _ess_limit(self) -> float:
        """Lower 95% limit of `ess`, by the chi-squared distribution of a variance of R values."""
        runs = self._replications
        return self.ess * float(chdtri(runs - 1, 0.95)) / (runs - 1) if runs > 1 else 0.0

    @property
    def relative_half_width(self) -> float:
        """Half the interval over p; infinite without events."""
        low, high = self.ci
        return 0.5 * (high - low) / self.p if self.p > 0 else math.inf

    @functools.cached_property
    def warnings(self) -> tuple[EstimateWarning, ...]:
        """As of any estimate, but that one replication may carry more than one rollout may."""
        usual = tuple(self._no_events(w) for w in super().warnings if w.name != "dominant-weight")
        if self.ess >= FEW_EVENTS > self._ess_limit and self.events:
            usual = (
                *usual,
                EstimateWarning(
                    "few-events",
                    f"worth {self.ess:.0f} events by the spread of {self._replications} replications, which may be as "
                    f"few as {self._ess_limit:.0f} (fewer than {FEW_EVENTS:g}): the standard error is itself uncertain",
                    "a larger budget; rely on the interval rather than on p +- std_error",
                ),
            )
        if self.max_weight_share <= DOMINANT_REPLICATION:
            return usual
        return (
            *usual,
            EstimateWarning(
                "dominant-weight",
                f"one of {self._replications} replications carries {self.max_weight_share:.0%} of the estimate: the "
                "chains do not reach all of the event, or there are too few of them",
                "a larger budget",
            ),
        )

    def _no_events(self, warning: EstimateWarning) -> EstimateWarning:
        """The warning; where nothing was found, what the interval is instead."""
        if warning.name != "no-events":
            return warning
        reached = self.f[np.isfinite(self.f)].min(initial=math.inf)
        return EstimateWarning(
            "no-events",
            f"no rollout had f <= {self.gamma:g}, the lowest was {reached:.4g}; the interval is an upper bound, no "
            f"tighter than naive Monte Carlo with {self.rollouts} rollouts has, as nothing tells what the levels "
            "have missed",
            warning.remedy,
        )

    def curve(self, gammas: ArrayLike) -> Curve:
        """p, standard error and pointwise interval at each threshold (m,)."""
        gammas = np.atleast_1d(np.asarray(gammas, dtype=np.float64))
        runs = self._replications
        if runs < 2:
            return Curve.unknown(gammas)
        values, counts = self._values(gammas)
        p = np.minimum(values.mean(axis=0), 1.0)
        spread = values.std(axis=0, ddof=1) / math.sqrt(runs)
        t = float(stdtrit(runs - 1, 0.5 + 0.5 * self._interval_confidence))
        std_error, low, high, ess = self._around(gammas, p, spread, counts, t)
        failed = self._weights[np.isnan(self.f)].sum() / runs
        nan = np.full(gammas.size, math.nan)
        return Curve(gammas, p, std_error, low, np.minimum(high + failed, 1.0), counts, ess, nan)

    def _around(
        self, gammas: Array, p: Array, std_error: Array, counts: NDArray[np.int64], t: float
    ) -> tuple[Array, Array, Array, Array]:
        """Standard error, both ends of the interval and effective number of events at each threshold (m,).

        std_error: of the mean over the replications (m,)
        counts: events behind p (m,)
        t: Student's, for the interval
        """
        some = p > 0
        relative = np.where(some, std_error / np.where(some, p, 1.0), 0.0)
        relative = np.where(some, np.maximum(relative, self._relative_floor(gammas)), 0.0)
        std_error = relative * p
        low, high = p * np.exp(-t * relative), np.minimum(p * np.exp(t * relative), 1.0)
        low, high = self._with_counts(p, low, high)
        high = np.where(some, high, self._bound())
        ess = np.where(relative > 0, np.where(relative > 0, relative, 1.0) ** -2.0, counts)
        return std_error, low, high, ess

    def _relative_floor(self, gammas: Array) -> Array:
        """Relative standard error at each threshold (m,), by the levels down to it: the square root of the sum of
        var(p_l) / (R mean(p_l)^2), p_l the share of a level's sample below the next, as if levels were
        independent."""
        passed = self.levels[self.levels > np.min(gammas, initial=math.inf)]
        out = np.zeros(gammas.size)
        for i, gamma in enumerate(gammas):
            down = np.append(passed[passed > gamma], gamma)
            reached = np.vstack([np.ones(self._replications), self._values(down)[0].T])
            if np.any(reached[-1] <= 0.0):
                continue  # a replication without events: their spread says it
            shares = reached[1:] / reached[:-1]
            spread = shares.var(axis=1, ddof=1) / np.mean(shares, axis=1) ** 2
            out[i] = math.sqrt(float(spread.sum()) / self._replications)
        return out

    def _with_counts(self, p: Array, low: Array, high: Array) -> tuple[Array, Array]:
        """The ends (m,), where most rollouts are events no closer to p than as many independent rollouts would say:
        there the replications hardly differ, or not at all."""
        n = self.f.size
        counted_low, counted_high = clopper_pearson(np.minimum(p, 1.0) * n, n, self._interval_confidence)
        common = p > MOSTLY_EVENTS
        return (
            np.where(common, np.minimum(low, counted_low), low),
            np.where(common, np.maximum(high, counted_high), high),
        )

    def _bound(self) -> float:
        """Upper end where nothing was found: of the largest weight there is, none of its tenth part; but no less
        than naive Monte Carlo with as many rollouts would say, as nothing tells what the levels have missed."""
        if not self.f.size:
            return 1.0
        weights = self._weights
        last = weights == weights.min()
        independent = max(int(np.count_nonzero(last)) // 10, 1)
        _, high = clopper_pearson(0, independent, self._interval_confidence)
        _, naive = clopper_pearson(0, self.rollouts, self._interval_confidence)
        return float(max(min(1.0, high * weights[last].sum() / self._replications * 2.0), naive))

    def trace(self, points: int = 100) -> Trace:
        """One point: replications have no meaningful prefix."""
        if not self._replications:
            return super().trace(points)
        low, high = self.ci
        at = np.array([self.estimation_rollouts], dtype=np.int64)
        return Trace(at, *(np.array([v]) for v in (self.p, self.std_error, low, high)))
