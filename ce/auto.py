"""Method "auto": searches, looks at its diagnostics, and switches to what they support.

    search    mixture sampling from the whole budget; its first iteration is a pilot from the base
              -> naive where at least COMMON of the pilot are events
              -> splitting where the last batch of the search holds no event and was hardly ahead of the base
              -> splitting (naive where the event is common enough for that) where after a fifth of the budget, and
                 after the look where one comes early, the proposals are still hardly ahead of the base, each at the
                 level it was fitted to
              -> naive where the proposal found promises less than naive Monte Carlo with the rollouts left
    trial     the first TRIAL of the fresh sample
              -> splitting (naive where the event is common enough for that) where that promises more than the
                 proposal does by its effective events, which count for less (DOUBT) where its weights are warned of
    estimate  the rest

What an abandoned stage has cost is counted as training, and nothing of it enters the estimate, whose interval and
warnings are those of the method that is left at the end (`est.method`).
"""

import functools
import math
from dataclasses import dataclass, replace

import msgspec
from numpy.typing import ArrayLike

from ce.checks import at_least, in_range
from ce.errors import BudgetError, StateError
from ce.headway import led, stalled
from ce.mixture import MixtureOptions, MixtureSampling
from ce.naive import Naive, NaiveOptions
from ce.posed import Posed
from ce.product import Product
from ce.protocol import Algorithm
from ce.results import FEW_EVENTS, Condition, Estimate, FailedRollout
from ce.splitting import Splitting, SplittingOptions
from ce.state import AutoState, Batch, EstimationRecord, MixtureState, TrainingRecord, to_bytes
from ce.streams import checked_seed

COMMON = 0.1  # share of events in the pilot from which naive Monte Carlo is taken
LEAST_SEARCH = 1000  # rollouts below which nothing but naive Monte Carlo is tried
DOUBT = 0.3  # what effective events are counted for where a warning says not to rely on them
COST = 36.0  # rollouts a level and effective event of splitting, measured (README)
TRIAL = 0.2  # of the fresh sample
ENOUGH_NAIVE = (
    400.0  # events expected of naive Monte Carlo from which it is preferred to splitting in any case
)
OFFSETS = {
    "mixture": 0,
    "naive": 1000,
    "splitting": 2000,
}  # added to a stage's iterations: keys stay distinct
_SHAKY = frozenset({"no-events", "dominant-weight", "heavy-tailed-weights"})


@dataclass(frozen=True)
class AutoOptions:
    """budget: rollouts at most; rel_error: relative half-width to stop at (None: spend the budget); confidence: of
    the interval; batch_size: estimation rollouts in a batch."""

    budget: int = 100_000
    rel_error: float | None = None
    confidence: float = 0.95
    batch_size: int = 5000

    def __post_init__(self) -> None:
        at_least("budget", self.budget, -(2**62))
        if self.budget < 1:
            raise BudgetError(f"budget must be at least 1 rollout, not {self.budget}")
        at_least("batch_size", self.batch_size, 1)
        in_range("confidence", self.confidence, 0, 1)
        if self.rel_error is not None:
            in_range("rel_error", self.rel_error, 0, math.inf)

    def held_rows(self, dim: int) -> int:
        """Rows of `dim` numbers that a state and its open batch hold together at most."""
        if self.budget < LEAST_SEARCH:
            return NaiveOptions(self.budget, batch_size=self.batch_size).held_rows(dim)
        search = MixtureOptions(self.budget, batch_size=self.batch_size)
        return max(search.held_rows(dim), SplittingOptions(self.budget).held_rows(dim))


@dataclass(frozen=True)
class Auto(Posed):
    """The algorithm: pure functions of a frozen state."""

    options: AutoOptions = AutoOptions()

    method = "auto"
    state_kind = AutoState

    @property
    def total_rollouts(self) -> int:
        """Rollouts at most."""
        return self.options.budget

    def init(self, seed: int = 0) -> AutoState:
        """The state before any rollout."""
        stage = "mixture" if self.options.budget >= LEAST_SEARCH else "naive"
        seed = checked_seed(seed)
        inner = self._inner(stage, 0)
        return AutoState(
            self.digest, seed, stage, 0, False, to_bytes(inner.init(_stage_seed(seed, stage))), (), ""
        )

    def propose(self, state: AutoState) -> Batch | None:
        """The next batch of the present stage; None when finished."""
        inner, within = self._open(state)
        batch = inner.propose(within)
        if batch is None:
            return None
        return msgspec.structs.replace(batch, iteration=batch.iteration + OFFSETS[state.stage], explicit=True)

    def update(
        self, state: AutoState, batch: Batch, f: ArrayLike
    ) -> tuple[AutoState, TrainingRecord | EstimationRecord]:
        """The state after the batch was answered with f (n,), and what happened; perhaps in another stage."""
        offset = OFFSETS[state.stage]
        inner, within = self._open(state)
        if batch.iteration < offset:
            raise StateError(f"the batch of iteration {batch.iteration} belongs to a stage that is over")
        own = msgspec.structs.replace(batch, iteration=batch.iteration - offset)
        after, record = inner.update(within, own, f)
        record = msgspec.structs.replace(record, iteration=record.iteration + offset)
        state = msgspec.structs.replace(state, inner=to_bytes(after))
        return self._switched(state, inner, after), record

    def estimate(self, state: AutoState) -> Estimate:
        """The estimate of the present stage, with the rollouts of all."""
        inner, within = self._open(state)
        est = inner.estimate(within)
        offset = OFFSETS[state.stage]
        failed = tuple(FailedRollout(phase, k, i) for phase, k, i in state.failed)
        failed += tuple(FailedRollout(r.phase, r.iteration + offset, r.index) for r in est.failed_rollouts)
        warnings = est.search_warnings
        if state.reason and est.finished and state.stage == "splitting":
            warnings = (
                *warnings,
                Condition("method-switched", state.reason, "none needed where the interval is narrow enough"),
            )
        return replace(
            est,
            rollouts=est.rollouts + state.spent,
            training_rollouts=est.training_rollouts + state.spent,
            failed_rollouts=failed,
            search_warnings=warnings,
        )

    def proposal(self, state: AutoState) -> Product:
        """As the present stage has it."""
        inner, within = self._open(state)
        return inner.proposal(within)

    # -- stages ----------------------------------------------------------------------------------------------

    @functools.lru_cache(maxsize=8)  # noqa: B019 (a few small objects; the algorithm outlives them anyway)
    def _inner(self, stage: str, spent: int) -> Algorithm:
        o = self.options
        left, precision, sure, size = o.budget - spent, o.rel_error, o.confidence, o.batch_size
        if stage == "naive":
            return Naive(self.base, self.gamma, NaiveOptions(left, precision, sure, size))
        if stage == "splitting":
            return Splitting(
                self.base, self.gamma, SplittingOptions(left, rel_error=precision, confidence=sure)
            )
        return MixtureSampling(
            self.base,
            self.gamma,
            MixtureOptions(left, rel_error=precision, confidence=sure, batch_size=size),
        )

    @functools.lru_cache(maxsize=1)  # noqa: B019 (one state, from `propose` to the `update` that answers it)
    def _opened(self, stage: str, spent: int, inner: bytes):
        return self._inner(stage, spent).from_bytes(inner)

    def _open(self, state: AutoState):
        return self._inner(state.stage, state.spent), self._opened(state.stage, state.spent, state.inner)

    def _switched(self, state: AutoState, inner: Algorithm, within) -> AutoState:
        """The state of the stage that the diagnostics call for."""
        if state.stage != "mixture" or within.phase == "done":
            return state
        est = inner.estimate(within)
        left = self.options.budget - est.rollouts
        last = within.records[-1]
        if len(within.records) == 1:
            if left > 0 and last.events >= COMMON * last.rollouts:
                return self._go(state, est, "naive", "the event is common")
            return state
        if within.phase == "train" and self._stalled(inner, within, est.rollouts):
            p = sum(within.shares) / len(within.shares)
            return self._rare(state, est, p, left, "the search is hardly ahead of naive Monte Carlo")
        if within.phase != "estimate":
            return state
        if within.f.size == 0:
            if last.events == 0:
                if led(within.headway):
                    return state  # what is fitted to a level just short of gamma may well reach it: the trial tells
                return self._rare(state, est, 0.0, left, "the search found no events")
            # What the last batch of the search was worth; an elite, at most one rollout of what is fitted to it.
            promised = within.worths[-1] if within.worths else last.ess / est.rollouts
            if _pilot_share(within) * left > max(promised * left, FEW_EVENTS):
                return self._go(
                    state, est, "naive", "the proposal found promises less than naive Monte Carlo"
                )
            return state
        fresh = within.f.size + left
        if not state.tried and within.f.size >= TRIAL * fresh:
            shaky = sorted(w.name for w in est.warnings if w.name in _SHAKY)
            worth = est.ess / max(est.f.size, 1) * left * (DOUBT if shaky else 1.0)
            if worth < max(est.p * left, _splitting_worth(est.p, left)):
                return self._rare(
                    state,
                    est,
                    est.p,
                    left,
                    f"the trial of the proposal was poor ({', '.join(shaky) or 'few-events'})",
                )
            return msgspec.structs.replace(state, tried=True)
        return state

    def _stalled(self, inner: Algorithm, within: MixtureState, rollouts: int) -> bool:
        assert isinstance(inner, MixtureSampling)
        looks = [k for k, record in enumerate(within.records) if "look" in record.summary]
        if not looks and inner.looks_early:
            return False  # modes that hold the search up may be found yet
        since = len(within.records) - 1 - looks[-1] if looks else None
        return stalled(within.headway, rollouts / self.options.budget, since)

    def _rare(self, state: AutoState, est: Estimate, p: float, left: int, reason: str) -> AutoState:
        if p * left >= min(ENOUGH_NAIVE, _splitting_worth(p, left)):
            return self._go(state, est, "naive", reason)
        return self._go(state, est, "splitting", reason) if left >= LEAST_SEARCH else state

    def _go(self, state: AutoState, est: Estimate, stage: str, reason: str) -> AutoState:
        inner = self._inner(stage, est.rollouts)
        return AutoState(
            digest=state.digest,
            seed=state.seed,
            stage=stage,
            spent=est.rollouts,
            tried=True,
            inner=to_bytes(inner.init(_stage_seed(state.seed, stage))),
            failed=tuple((r.phase, r.iteration, r.index) for r in est.failed_rollouts),
            reason=f"{reason}: method {stage} took over after {est.rollouts} rollouts",
        )


def _pilot_share(within) -> float:
    """p by the pilot, whose rollouts are the base's: its lower end, so that a lucky event decides nothing."""
    events = within.records[0].events
    return max(events - 2.0 * math.sqrt(events), 0.0) / within.records[0].rollouts


def _splitting_worth(p: float, rollouts: int) -> float:
    """Effective events that splitting makes of so many rollouts: rollouts / (COST L^2), L = log10(1 / p) levels."""
    return rollouts / (COST * math.log10(1.0 / min(max(p, 1e-12), 0.1)) ** 2)


def _stage_seed(seed: int, stage: str) -> int:
    """Stages share no streams."""
    return (seed + OFFSETS[stage] * 0x9E3779B97F4A7C15) % 2**64
