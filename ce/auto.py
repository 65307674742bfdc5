"""Method "auto": searches, looks at its diagnostics, and switches to what they support.

    search    mixture sampling from the whole budget; its first iteration is a pilot from the base
              -> naive where at least COMMON of the pilot are events
              -> splitting where the last batch of the search holds no event and was hardly ahead of the base
              -> splitting (naive where the event is common enough for that) where after a fifth of the budget, and
                 after the mode search where one comes early, the proposals are still hardly ahead of the base, each at
                 the level it was fitted to
              -> naive where the proposal found promises less than naive Monte Carlo with the rollouts left
    trial     the first TRIAL of the fresh sample
              -> splitting (naive where the event is common enough for that) where that promises more than the
                 proposal does by its effective events, which count for less (DISCOUNT) where its weights are warned of
    estimate  the rest

What an abandoned stage has cost is counted as training, and nothing of it enters the estimate, whose interval and
warnings are those of the method that is left at the end (`est.method`).
"""

import functools
import math
from dataclasses import dataclass, replace
from typing import Any

import msgspec
from numpy.typing import ArrayLike

from ce.codec import to_bytes
from ce.errors import StateError
from ce.estimate_warnings import FEW_EVENTS, EstimateWarning
from ce.estimator import Estimator
from ce.log_efficiency import stalled, well_ahead
from ce.mixture import MixtureOptions, MixtureSampling
from ce.naive import Naive, NaiveOptions
from ce.product import Product
from ce.protocol import Algorithm
from ce.records import Batch, EstimationRecord, TrainingRecord
from ce.results import Estimate, FailedRollout
from ce.splitting import Splitting, SplittingOptions
from ce.state import AutoState, MixtureState

# Share of events in the pilot from which naive Monte Carlo is taken.
COMMON = 0.1
# Rollouts below which nothing but naive Monte Carlo is tried.
LEAST_SEARCH = 1000
# What effective events are counted for where a warning says not to rely on them.
DISCOUNT = 0.3
# Rollouts a level and effective event of splitting, measured (README).
COST = 36.0
# Of the fresh sample.
TRIAL = 0.2
# Events expected of naive Monte Carlo from which it is preferred to splitting in any case.
ENOUGH_NAIVE = 400.0
# Added to a stage's iterations, so that keys stay distinct.
OFFSETS = {"mixture": 0, "naive": 1000, "splitting": 2000}
_UNRELIABLE = frozenset({"no-events", "dominant-weight", "heavy-tailed-weights"})


@dataclass(frozen=True)
class AutoOptions(NaiveOptions):
    """Options of method auto.

    budget: rollouts at most
    rel_error: relative half-width of the interval to stop at (None: spend the budget)
    confidence: of the interval, in (0, 1)
    batch_size: estimation rollouts in a batch
    """

    def held_rows(self, dim: int) -> int:
        """Rows of `dim` numbers that a state and its open batch hold together at most."""
        if self.budget < LEAST_SEARCH:
            return NaiveOptions(self.budget, batch_size=self.batch_size).held_rows(dim)
        search = MixtureOptions(self.budget, batch_size=self.batch_size)
        return max(search.held_rows(dim), SplittingOptions(self.budget).held_rows(dim))


@dataclass(frozen=True)
class Auto(Estimator[AutoState], method="auto", state_type=AutoState):
    """Method auto as pure functions of a frozen `AutoState`."""

    options: AutoOptions = AutoOptions()

    def _initial(self, seed: int) -> AutoState:
        stage = "mixture" if self.options.budget >= LEAST_SEARCH else "naive"
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
                EstimateWarning(
                    "method-switched", state.reason, "none needed where the interval is narrow enough"
                ),
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
    def _inner(self, stage: str, spent: int) -> Algorithm[Any]:
        """The algorithm of a stage that begins after so many rollouts."""
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
    def _opened(self, stage: str, spent: int, inner: bytes) -> Any:
        return self._inner(stage, spent).from_bytes(inner)

    def _open(self, state: AutoState) -> tuple[Algorithm[Any], Any]:
        """The present stage's algorithm and its own state."""
        return self._inner(state.stage, state.spent), self._opened(state.stage, state.spent, state.inner)

    def _switched(self, state: AutoState, inner: Algorithm[Any], within: Any) -> AutoState:
        """The state of the stage that the diagnostics call for."""
        if not isinstance(within, MixtureState) or within.phase == "done":
            return state
        est = inner.estimate(within)
        left = self.options.budget - est.rollouts
        if len(within.records) == 1:
            pilot = within.records[0]
            if left > 0 and pilot.events >= COMMON * pilot.rollouts:
                return self._switch(state, est, "naive", "the event is common")
            return state
        if within.phase == "train" and self._stalled(inner, within, est.rollouts):
            p = sum(within.search.shares) / len(within.search.shares)
            return self._switch_as_rare(
                state, est, p, left, "the search is hardly ahead of naive Monte Carlo"
            )
        if within.phase != "estimate":
            return state
        if within.sample.f.size == 0:
            return self._after_search(state, within, est, left)
        if not state.tried and within.sample.f.size >= TRIAL * (within.sample.f.size + left):
            return self._after_trial(state, est, left)
        return state

    def _after_search(self, state: AutoState, within: MixtureState, est: Estimate, left: int) -> AutoState:
        """Where the proposal found promises too little for a trial, another stage."""
        last, search = within.records[-1], within.search
        if last.events == 0:
            # What is fitted to a level just short of gamma may well reach it: the trial tells.
            if well_ahead(search.log_efficiencies):
                return state
            return self._switch_as_rare(state, est, 0.0, left, "the search found no events")
        # What the last batch of the search was worth; an elite, at most one rollout of what is fitted to it.
        promised = search.ess_rates[-1] if search.ess_rates else last.ess / est.rollouts
        if _pilot_share(within) * left > max(promised * left, FEW_EVENTS):
            reason = "the proposal found promises less than naive Monte Carlo"
            return self._switch(state, est, "naive", reason)
        return state

    def _after_trial(self, state: AutoState, est: Estimate, left: int) -> AutoState:
        """Where the trial of the proposal was poor, another stage."""
        named = sorted(w.name for w in est.warnings if w.name in _UNRELIABLE)
        promised = est.ess / max(est.f.size, 1) * left * (DISCOUNT if named else 1.0)
        if promised < max(est.p * left, _splitting_ess(est.p, left)):
            reason = f"the trial of the proposal was poor ({', '.join(named) or 'few-events'})"
            return self._switch_as_rare(state, est, est.p, left, reason)
        return msgspec.structs.replace(state, tried=True)

    def _stalled(self, inner: Algorithm[Any], within: MixtureState, rollouts: int) -> bool:
        assert isinstance(inner, MixtureSampling)
        searched = [k for k, record in enumerate(within.records) if "mode_search" in record.summary]
        if not searched and inner.searches_modes_early:
            return False  # modes that hold the search up may be found yet
        since = len(within.records) - 1 - searched[-1] if searched else None
        return stalled(within.search.log_efficiencies, rollouts / self.options.budget, since)

    def _switch_as_rare(self, state: AutoState, est: Estimate, p: float, left: int, reason: str) -> AutoState:
        """To splitting; to naive Monte Carlo where p is large enough for that; nowhere with too few rollouts left."""
        if p * left >= min(ENOUGH_NAIVE, _splitting_ess(p, left)):
            return self._switch(state, est, "naive", reason)
        return self._switch(state, est, "splitting", reason) if left >= LEAST_SEARCH else state

    def _switch(self, state: AutoState, est: Estimate, stage: str, reason: str) -> AutoState:
        """The state before the first batch of another stage."""
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


def _pilot_share(within: MixtureState) -> float:
    """p by the pilot, whose rollouts are the base's: its lower end, so that a lucky event decides nothing."""
    events = within.records[0].events
    return max(events - 2.0 * math.sqrt(events), 0.0) / within.records[0].rollouts


def _splitting_ess(p: float, rollouts: int) -> float:
    """Effective events that splitting makes of so many rollouts: rollouts / (COST L^2), L = log10(1 / p) levels."""
    return rollouts / (COST * math.log10(1.0 / min(max(p, 1e-12), 0.1)) ** 2)


def _stage_seed(seed: int, stage: str) -> int:
    """Stages share no streams."""
    return (seed + OFFSETS[stage] * 0x9E3779B97F4A7C15) % 2**64
