"""The estimate from independent batches of paths, its interval and its warnings."""

import functools
import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from ce.estimate_warnings import EstimateWarning
from ce.interval import clopper_pearson
from ce.replicated import ReplicatedEstimate

Array = NDArray[np.float64]

# Share of one root in p, and of all roots kept by the floor alone, above which it is said so.
DOMINANT_ROOT, FLOOR_SHARE = 0.1, 0.1
# Standard errors between the logarithms of the estimate and of the pilot's from which it is said so: few roots tell
# a standard error that is too small where they have missed what matters.
DISAGREES = 3.0


@dataclass(frozen=True)
class Cost:
    """What an estimate has cost; `path` is one path from its start to its end, unsplit.

    steps: simulated, training included
    training_steps: those of the pilot
    begun: paths begun, by splitting too, training included
    training_begun: those of the pilot
    path_steps: of a path as naive Monte Carlo drives it, on average
    """

    steps: int
    training_steps: int
    begun: int
    training_begun: int
    path_steps: float


@dataclass(frozen=True)
class PathEstimate(ReplicatedEstimate):
    """An estimate whose p is the mean over independent batches of weighted paths; otherwise as `ReplicatedEstimate`.

    std_error is that of the mean of B batches. ci is Student's t on B - 1 degrees of freedom on the logarithm of p,
    its upper end with the largest root's contribution q added: (p + q) exp(t sqrt(std_error^2 + q^2) / (p + q)).
    Without events it goes from 0 to the least of what the pilot's naive paths leave open and what as many naive
    paths as starts drawn over the largest weight met would. f are the smallest measures of the paths; log_weights
    their log weights over the starts drawn for a batch; replication the number of each one's batch; rollouts the
    paths begun.

    batches: number of batches
    starts: drawn for a batch, driven or not
    root: (n,) int64, number of each path's root
    floored: (n,) bool, whether that root was kept by the floor of the importance alone
    x: (r, d), of the roots
    seeds: (r,) uint64, of the roots
    lineage: (n, T) uint64, keys of each path's segments
    cost: in simulated steps and in paths begun
    pilot_p: unbiased estimate of the pilot's own at gamma, and its standard error; NaN where it has none
    """

    batches: int = 0
    starts: int = 0
    root: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, dtype=np.int64), repr=False)
    floored: NDArray[np.bool_] = field(default_factory=lambda: np.zeros(0, dtype=np.bool_), repr=False)
    x: Array = field(default_factory=lambda: np.zeros((0, 0)), repr=False)
    seeds: NDArray[np.uint64] = field(default_factory=lambda: np.zeros(0, dtype=np.uint64), repr=False)
    lineage: NDArray[np.uint64] = field(default_factory=lambda: np.zeros((0, 0), dtype=np.uint64), repr=False)
    cost: Cost = Cost(0, 0, 0, 0, math.nan)
    pilot_p: tuple[float, float] = (math.nan, math.nan)

    @functools.cached_property
    def _replications(self) -> int:
        return self.batches

    @functools.cached_property
    def _at_root(self) -> Array:
        """Each root's share of p (r,)."""
        hit = self.f <= self.gamma
        sums = np.bincount(self.root[hit], self._weights[hit])
        total = sums.sum()
        return np.asarray(sums / total if total > 0 else sums)

    @functools.cached_property
    def max_weight_share(self) -> float:
        """The largest root's share of p, 0 without events."""
        return float(self._at_root.max(initial=0.0))

    @property
    def efficiency(self) -> float:
        """p (1 - p) path_steps / (steps std_error^2), NaN without events.

        It is the variance of naive Monte Carlo with as many simulated steps, training counted, over this estimate's
        own variance estimate; `efficiency_by_begun` counts paths begun instead.
        """
        return self._efficiency(self.cost.steps / self.cost.path_steps)

    @property
    def efficiency_by_begun(self) -> float:
        """As `efficiency`, with as many naive paths as paths were begun."""
        return self._efficiency(self.cost.begun)

    def _efficiency(self, paths: float) -> float:
        if not self.p > 0 or not self.std_error > 0:
            return math.nan
        return self.p * (1.0 - self.p) / paths / self.std_error**2

    def _around(
        self, gammas: Array, p: Array, std_error: Array, counts: NDArray[np.int64], t: float
    ) -> tuple[Array, Array, Array, Array]:
        """As of any replications, but above the aimed threshold more widely spread."""
        largest = np.array([self._largest_root(g) for g in gammas])
        some = p > 0
        one = np.where(some, p, 1.0)
        low = np.where(some, p * np.exp(-t * std_error / one), 0.0)
        top = one + largest
        high = np.where(some, top * np.exp(t * np.hypot(std_error, largest) / top), self._bound())
        ess = np.where(std_error > 0, (p / np.where(std_error > 0, std_error, 1.0)) ** 2, counts)
        return std_error, low, high, ess

    def _largest_root(self, gamma: float) -> float:
        """What the root that carries most adds to p."""
        hit = self.f <= gamma
        return float(np.bincount(self.root[hit], self._weights[hit]).max(initial=0.0)) / self.batches

    def _no_events(self, warning: EstimateWarning) -> EstimateWarning:
        if warning.name != "no-events":
            return warning
        lowest = float(np.nanmin(self.f, initial=math.inf))
        return EstimateWarning(
            "no-events",
            f"no path came to {self.gamma:g}, the lowest to {lowest:.4g}; the interval is an "
            "upper bound, by the pilot's naive paths or by the starts drawn over the largest weight met",
            warning.remedy,
        )

    def _bound(self) -> float:
        """Upper end where nothing was found."""
        largest = max(float(np.max(self._weights, initial=0.0)) * self.starts, 1.0)
        bounds = [clopper_pearson(0, int(self.batches * self.starts / largest), self._interval_confidence)[1]]
        if self.base_f.size:
            events = np.count_nonzero(self.base_f <= self.gamma) + np.count_nonzero(np.isnan(self.base_f))
            bounds.append(clopper_pearson(events, self.base_f.size, self._interval_confidence)[1])
        return float(min(bounds))

    @functools.cached_property
    def warnings(self) -> tuple[EstimateWarning, ...]:
        """What bears on how far the estimate can be relied on; see README.md, "Warnings"."""
        usual = tuple(w for w in super().warnings if w.name != "dominant-weight")
        return (*usual, *_of_paths(self))


def _of_paths(est: PathEstimate) -> list[EstimateWarning]:
    found: list[EstimateWarning] = []
    if est.batches == 0 or est.events == 0:
        return found
    if est.max_weight_share > DOMINANT_ROOT:
        found.append(
            EstimateWarning(
                "dominant-root",
                f"one start and the paths split from it carry {est.max_weight_share:.0%} of the estimate (more than "
                f"{DOMINANT_ROOT:.0%}): the committor holds such starts for less dangerous than they are",
                "a larger budget, which trains the committor longer, too; rely on the interval",
            )
        )
    floored = np.flatnonzero(est.floored & (est.f <= est.gamma))
    w = np.exp(est.log_weights) if est.log_weights is not None else np.ones(est.f.size)
    share = float(w[floored].sum() / w[est.f <= est.gamma].sum())
    if share > FLOOR_SHARE:
        found.append(
            EstimateWarning(
                "floor-roots",
                f"starts that the committor held for unimportant carry {share:.0%} of the estimate (more than "
                f"{FLOOR_SHARE:.0%}): others like them may be missing",
                "a larger budget, which trains the committor longer, too; or a committor of a similar problem",
            )
        )
    p, std_error = est.pilot_p
    apart = abs(math.log(est.p / p)) if std_error > 0 else 0.0
    if std_error > 0 and apart > DISAGREES * math.hypot(std_error / p, est.std_error / est.p):
        found.append(
            EstimateWarning(
                "pilot-disagrees",
                f"p = {est.p:.3g} +- {est.std_error:.2g}, but the pilot's own paths, unbiased too, gave {p:.3g} +- "
                f"{std_error:.2g}: their logarithms are more than {DISAGREES:g} standard errors apart",
                "a larger budget, and a run with another seed beside this one",
            )
        )
    return found
