"""Estimates whose precision comes from independent replications, not from independent rollouts."""

import functools
import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import stdtrit

from ce.interval import clopper_pearson
from ce.results import Condition, Curve, Estimate, Trace

Array = NDArray[np.float64]

DOMINANT_REPLICATION = 0.4  # share of one replication in p above which it is said so


@dataclass(frozen=True)
class ReplicatedEstimate(Estimate):
    """p is the mean over R replications; each is a set of weighted values of f whose weights sum to one.

    f, log_weights, replication: (n,) value, log weight and replication of each. std_error: of the mean of R
    independent values. ci: Student's t on R - 1 degrees of freedom on the logarithm of p (delta method), because
    replications are skewed; without events, from 0 to what the last level reached leaves open. ess: (p / std_error)^2,
    the number of events that naive Monte Carlo would need for this precision. max_weight_share: the largest
    replication's share of p.
    """

    replication: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, dtype=np.int64), repr=False)

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
        values = self._values(np.array([self.gamma]))[0][:, 0]
        return float(values.max() / values.sum()) if values.size and values.sum() > 0 else 0.0

    @property
    def relative_half_width(self) -> float:
        """Half the interval over p; infinite without events."""
        low, high = self.ci
        return 0.5 * (high - low) / self.p if self.p > 0 else math.inf

    @functools.cached_property
    def warnings(self) -> tuple[Condition, ...]:
        """As of any estimate, but that one replication may carry more than one rollout may."""
        usual = tuple(w for w in super().warnings if w.name != "dominant-weight")
        if self.max_weight_share <= DOMINANT_REPLICATION:
            return usual
        return (
            *usual,
            Condition(
                "dominant-weight",
                f"one of {self._replications} replications carries {self.max_weight_share:.0%} of the estimate: the "
                "chains do not reach all of the event, or there are too few of them",
                "a larger budget",
            ),
        )

    def curve(self, gammas: ArrayLike) -> Curve:
        """p, standard error and pointwise interval at each threshold (m,)."""
        gammas = np.atleast_1d(np.asarray(gammas, dtype=np.float64))
        m, runs = gammas.size, self._replications
        nan = np.full(m, math.nan)
        if runs < 2:
            return Curve(
                gammas, nan, nan, np.zeros(m), np.ones(m), np.zeros(m, dtype=np.int64), np.zeros(m), nan
            )
        values, counts = self._values(gammas)
        p = values.mean(axis=0)
        std_error = values.std(axis=0, ddof=1) / math.sqrt(runs)
        t = float(stdtrit(runs - 1, 0.5 + 0.5 * self._sure))
        some = p > 0
        relative = np.where(some, std_error / np.where(some, p, 1.0), 0.0)
        low, high = p * np.exp(-t * relative), np.minimum(p * np.exp(t * relative), 1.0)
        high = np.where(some, high, self._bound())
        failed = self._weights[np.isnan(self.f)].sum() / runs
        ess = np.where(relative > 0, np.where(relative > 0, relative, 1.0) ** -2.0, counts)
        return Curve(gammas, p, std_error, low, np.minimum(high + failed, 1.0), counts, ess, nan)

    def _bound(self) -> float:
        """Upper end where nothing was found: of the largest weight there is, none of its tenth part."""
        if not self.f.size:
            return 1.0
        weights = self._weights
        last = weights == weights.min()
        independent = max(int(np.count_nonzero(last)) // 10, 1)
        _, high = clopper_pearson(0, independent, self._sure)
        return float(min(1.0, high * weights[last].sum() / self._replications * 2.0))

    def trace(self, points: int = 100) -> Trace:
        """One point: replications have no meaningful prefix."""
        if not self._replications:
            return super().trace(points)
        low, high = self.ci
        at = np.array([self.estimation_rollouts], dtype=np.int64)
        return Trace(at, *(np.array([v]) for v in (self.p, self.std_error, low, high)))
