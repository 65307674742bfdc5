"""States, batches and totals of the method for paths, as `ce.codec` writes them."""

import math
from collections.abc import Sequence

import msgspec
import numpy as np
from numpy.typing import NDArray

from ce.codec import FORMAT
from ce.estimate_warnings import EstimateWarning
from ce.paths.network import NetworkCommittor
from ce.paths.path_estimate import Cost, PathEstimate
from ce.paths.plan import Plan
from ce.paths.starts import Roots
from ce.paths.training import Lessons
from ce.paths.tree import Driven, Fallen, joined_falls
from ce.product import Product
from ce.results import FailedRollout

Array = NDArray[np.float64]

# Hits of a pilot's round from which its own estimate is compared with the final one.
COMPARABLE_HITS = 10
# Roots of the estimate with an event from which it does not matter where the pilot has come to.
KNOWN_ROOTS = 15
# Rounds of the pilot whose paths together tell how far it has come.
POOLED = 3


class PathBatch(msgspec.Struct, frozen=True, eq=False):
    """Roots to be driven: `drive(process, roots, levels, process.checkpoints, plan, committor, record)`.

    phase: "train" or "estimate"
    iteration: number of the batch within the phase
    roots: kept starts; any part of them may be driven elsewhere, the answers put together by `joined`
    starts: that were drawn
    levels: (L,), at which events are counted
    record: whether the answer is to hold what a committor learns from
    plan: None for paths that are neither split nor ended
    committor: that the plan is for; None where another kind was given to the algorithm
    """

    phase: str
    iteration: int
    roots: Roots
    starts: int
    levels: Array
    record: bool
    plan: Plan | None
    committor: NetworkCommittor | None


class PathTotals(msgspec.Struct, frozen=True):
    """What one batch came to.

    phase: "train" or "estimate"
    iteration: number of the batch
    starts: drawn
    roots: driven
    begun: paths begun, by splitting too
    steps: simulated
    hits: paths that came to gamma
    p: estimate of the probability by this batch alone
    std_error: its standard error, by its roots
    failed: (phase, iteration, root) of each failed path
    """

    phase: str
    iteration: int
    starts: int
    roots: int
    begun: int
    steps: int
    hits: int
    p: float
    std_error: float
    failed: tuple[tuple[str, int, int], ...]


def result(batch: PathBatch, driven: Driven, gamma: float) -> PathTotals:
    """The totals of a driven batch."""
    hit = driven.value <= gamma
    sums = np.bincount(driven.root[hit], driven.weight[hit], minlength=1) / batch.starts
    return PathTotals(
        phase=batch.phase,
        iteration=batch.iteration,
        starts=batch.starts,
        roots=batch.roots.size,
        begun=int(driven.begun.sum()),
        steps=int(driven.steps.sum()),
        hits=int(np.count_nonzero(hit)),
        p=float(sums.sum()),
        std_error=float(np.sqrt(np.sum(sums**2))),
        failed=tuple(
            (batch.phase, batch.iteration, int(batch.roots.rows[r]))
            for r in driven.root[np.isnan(driven.value)]
        ),
    )


class Round(msgspec.Struct, frozen=True):
    """A round of the pilot.

    totals: what it came to
    aim: level that it was aimed at
    reached: lowest level that enough of its paths, or of an earlier round's, have come to, not below gamma
    population: paths that it was planned for, 0 for the naive one
    """

    totals: PathTotals
    aim: float
    reached: float
    population: float


class Falls(msgspec.Struct, frozen=True, eq=False):
    """How far the paths of one round have come.

    fallen: where they came to lower values
    starts: that they stand for
    """

    fallen: Fallen
    starts: int


def pooled(rounds: Sequence[Falls]) -> Falls:
    """The paths of several rounds as of one."""
    first = np.cumsum([0] + [int(r.fallen.root.max(initial=-1)) + 1 for r in rounds])
    moved = [
        msgspec.structs.replace(r.fallen, root=r.fallen.root + at)
        for r, at in zip(rounds, first[:-1], strict=True)
    ]
    return Falls(joined_falls(moved), sum(r.starts for r in rounds))


class Sample(msgspec.Struct, frozen=True, eq=False):
    """Paths of the estimate that came to their ends.

    f: (n,), smallest measures, NaN = failed
    log_weight: (n,), over the starts of a batch
    root: (n,), row of `x`
    batch: (n,)
    lineage: (n, T) uint64
    x: (r, d), of the roots
    seeds: (r,) uint64
    floored: (r,) bool
    """

    f: Array
    log_weight: Array
    root: NDArray[np.int64]
    batch: NDArray[np.int64]
    lineage: NDArray[np.uint64]
    x: Array
    seeds: NDArray[np.uint64]
    floored: NDArray[np.bool_]

    @classmethod
    def of(cls, batch: PathBatch, driven: Driven) -> "Sample":
        """The paths of one batch."""
        return cls(
            driven.value,
            np.log(driven.weight / batch.starts),
            driven.root,
            np.zeros(driven.value.size, dtype=np.int64),
            driven.lineage,
            batch.roots.x,
            batch.roots.seeds,
            batch.roots.floored,
        )


def joined_samples(one: Sample | None, other: Sample, number: int) -> Sample:
    """The paths so far and those of batch `number`."""
    other = msgspec.structs.replace(other, batch=np.full(other.f.size, number))
    if one is None:
        return other
    moved = msgspec.structs.replace(other, root=other.root + one.seeds.size)
    return Sample(*(np.concatenate([getattr(one, n), getattr(moved, n)]) for n in Sample.__struct_fields__))


class PathState(msgspec.Struct, frozen=True, eq=False):
    """The method for paths.

    digest: of the problem, the options and the committor that was given
    seed: of the streams
    phase: "pilot", "estimate" or "done"
    iteration: rounds of the pilot, or batches of the estimate, answered so far
    committor: as trained so far
    plan: of the next batch, None for naive paths
    starts: drawn for the next batch
    population: paths that it is planned for
    aim: lowest level that enough paths have come to, not below gamma
    batches: of the estimate
    lessons: what the pilot has taught so far
    rounds: of the pilot
    falls: how far the paths of the last POOLED rounds have come
    naive_f: (n,), smallest measures of its naive paths
    naive_steps: simulated for them
    steps: simulated so far
    begun: paths begun so far
    training_steps: of the pilot
    training_begun: of the pilot
    sample: paths of the estimate
    failed: (phase, iteration, root) of each failed path
    """

    digest: str
    seed: int
    phase: str = "pilot"
    iteration: int = 0
    committor: NetworkCommittor | None = None
    plan: Plan | None = None
    starts: int = 0
    population: float = 0.0
    aim: float = math.inf
    batches: int = 0
    lessons: tuple[Lessons, ...] = ()
    rounds: tuple[Round, ...] = ()
    falls: tuple[Falls, ...] = ()
    naive_f: Array = msgspec.field(default_factory=lambda: np.zeros(0))
    naive_steps: int = 0
    steps: int = 0
    begun: int = 0
    training_steps: int = 0
    training_begun: int = 0
    sample: Sample | None = None
    failed: tuple[tuple[str, int, int], ...] = ()
    method: str = "paths"
    format: int = FORMAT

    def estimate(self, base: Product, gamma: float, confidence: float, horizon: int) -> PathEstimate:
        """The estimate so far."""
        s = self.sample
        whole = self.naive_steps / self.naive_f.size if self.naive_f.size else float(horizon)
        none = np.zeros(0)
        return PathEstimate(
            gamma=gamma,
            method=self.method,
            confidence=confidence,
            rollouts=self.begun,
            training_rollouts=self.training_begun,
            f=none if s is None else s.f,
            log_weights=none if s is None else s.log_weight,
            proposal=base,
            finished=self.phase == "done",
            failed_rollouts=tuple(FailedRollout(*f) for f in self.failed),
            search_warnings=tuple(self._warnings(gamma)),
            base_f=self.naive_f,
            replication=none.astype(np.int64) if s is None else s.batch,
            batches=0 if s is None else self.iteration,
            starts=self.starts,
            root=none.astype(np.int64) if s is None else s.root,
            floored=none.astype(np.bool_) if s is None else s.floored[s.root],
            x=none.reshape(0, base.dim) if s is None else s.x,
            seeds=none.astype(np.uint64) if s is None else s.seeds,
            lineage=np.zeros((0, 0), dtype=np.uint64) if s is None else s.lineage,
            cost=Cost(self.steps, self.training_steps, self.begun, self.training_begun, whole),
            pilot_p=self._pilot_p(),
        )

    def _pilot_p(self) -> tuple[float, float]:
        """Mean of the estimates at gamma of those rounds with enough hits, and its standard error."""
        told = [r.totals for r in self.rounds if r.totals.hits >= COMPARABLE_HITS]
        if not told:
            return math.nan, math.nan
        return (
            sum(t.p for t in told) / len(told),
            math.sqrt(sum(t.std_error**2 for t in told)) / len(told),
        )

    def _roots_at(self, gamma: float) -> int:
        """Roots of the estimate whose paths came to gamma."""
        return 0 if self.sample is None else np.unique(self.sample.root[self.sample.f <= gamma]).size

    def _warnings(self, gamma: float) -> list[EstimateWarning]:
        if self.phase == "pilot":
            return []
        found = []
        if self.aim > gamma and self.naive_f.size and self._roots_at(gamma) < KNOWN_ROOTS:
            found.append(
                EstimateWarning(
                    "threshold-not-reached",
                    f"the lowest level that enough of the pilot's paths came to is {self.aim:.4g}, above gamma = "
                    f"{gamma:g}: the committor has learned little of what lies below",
                    "a larger budget",
                )
            )
        if self.phase == "done" and self.sample is None:
            found.append(
                EstimateWarning(
                    "budget-spent", "the pilot left too little for the estimate", "a larger budget"
                )
            )
        return found
