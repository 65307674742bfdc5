"""Multilevel splitting (subset simulation) with preconditioned Crank-Nicolson moves in standard-normal space.

p = prod_l P(f <= b_{l+1} | f <= b_l),  inf = b_0 > b_1 > ... > b_L = gamma.

A pilot, one adaptive run (`ce.splitting_pilot`), fixes the levels b_l and the moves' step sizes. Then `replications`
independent runs with those levels and steps (`ce.splitting_replications`), none of which adapts anything: each is
unbiased for p, so their mean is, and their spread is an honest standard error whatever the chains' correlation.

In a run, level l holds N samples. Those with f <= b_{l+1} are survivors; N / chain of them are chosen as seeds and each
grows a Markov chain of `chain` states (`ce.chains`) within f <= b_{l+1}.
"""

import math
from dataclasses import dataclass, field

import msgspec
import numpy as np
from numpy.typing import ArrayLike, NDArray

from ce import splitting_pilot, splitting_replications
from ce.chains import Chains
from ce.checks import checked_response, checked_turn
from ce.estimate_warnings import EstimateWarning
from ce.estimator import Estimator
from ce.naive import record_of
from ce.product import Product
from ce.records import Batch, EstimationRecord, TrainingRecord
from ce.replicated import ReplicatedEstimate
from ce.results import SAMPLING_SHARE, FailedRollout
from ce.splitting_options import LEAST_BUDGET, SplittingOptions
from ce.standard import from_standard
from ce.state import LevelState, SplittingState
from ce.streams import generator
from ce.weights import order_statistic

__all__ = ["LEAST_BUDGET", "Splitting", "SplittingOptions"]

Array = NDArray[np.float64]

_MOVE_KIND = 0x73706C69


@dataclass(frozen=True)
class Splitting(Estimator[SplittingState], method="splitting", state_type=SplittingState):
    """Multilevel splitting as pure functions of a frozen `SplittingState`."""

    options: SplittingOptions = field(default_factory=SplittingOptions)

    def _initial(self, seed: int) -> SplittingState:
        return SplittingState(
            digest=self.digest,
            seed=seed,
            phase="pilot",
            batches=0,
            rollouts=0,
            level=self._level_0(),
            pilot=splitting_pilot.initial_pilot(self.options.pilot_size, self.base.dim),
            replications=splitting_replications.no_replications(),
            failed=(),
        )

    def propose(self, state: SplittingState) -> Batch | None:
        """The next batch, a level-0 sample or one move of every chain; None when finished."""
        if state.phase == "done":
            return None
        u, noise, _ = self._proposed(state)
        x = from_standard(self.base, u)
        return Batch(
            phase="train",
            iteration=state.batches,
            x=x,
            noise=noise,
            parameters=self.base.parameters(),
            seed=state.seed,
            start=0,
            stop=x.shape[0],
            explicit=True,
        )

    def update(
        self, state: SplittingState, batch: Batch, f: ArrayLike
    ) -> tuple[SplittingState, TrainingRecord | EstimationRecord]:
        """The state after the batch was answered with f (n,), NaN = failed rollout, and what happened."""
        checked_turn(batch, state.seed, "train", state.batches, 0)
        values = checked_response(batch, f)
        u, noise, steps = self._proposed(state)
        after = self._counted(state, values)
        after = (
            self._begun(after, u, values, noise)
            if self._begins(state)
            else self._moved(after, u, values, noise)
        )
        after = self._kept(after)
        if after.level.number == 0 or after.level.chain_length == self.options.chain:
            after = self._after_pilot_level(after) if after.phase == "pilot" else self._after_level(after)
        return after, self._record(state, after, values, steps)

    def estimate(self, state: SplittingState) -> ReplicatedEstimate:
        """The estimate so far, from the replications that are finished; p is NaN before there are two."""
        made = splitting_replications.finished(state.replications)
        return ReplicatedEstimate(
            gamma=self.gamma,
            method=self.method,
            confidence=self.options.confidence,
            rollouts=state.rollouts,
            training_rollouts=state.pilot.rollouts,
            f=made.f,
            log_weights=made.log_weights,
            proposal=self.base,
            finished=state.phase == "done",
            rel_error=self.options.rel_error,
            failed_rollouts=tuple(FailedRollout("train", k, i) for k, i in state.failed),
            search_warnings=tuple(self._search_warnings(state)),
            base_f=state.pilot.base_f,
            replication=made.replication,
            levels=state.pilot.levels,
            spending=1.0 / self.options.interim_looks,
            sampling_share=SAMPLING_SHARE,
        )

    def proposal(self, state: SplittingState) -> Product:
        """The base: what the moves leave as it is."""
        return self.base

    # -- a batch ---------------------------------------------------------------------------------------------

    @staticmethod
    def _begins(state: SplittingState) -> bool:
        """Whether the next batch is the sample of level 0."""
        return state.level.number == 0

    def _level_0(self) -> LevelState:
        none = Chains.none(self.base.dim)
        return LevelState(0, 0, none, none)

    def _proposed(self, state: SplittingState) -> tuple[Array, NDArray[np.uint64], Array]:
        """u and noise of the batch, and the step sizes used; a function of the state alone."""
        source = generator(state.seed, _MOVE_KIND, "train", state.batches, 0)
        pilot = state.phase == "pilot"
        if self._begins(state):
            d, made = self.base.dim, state.replications
            n = state.pilot.size if pilot else made.group_size * made.size
            return source.standard_normal((n, d)), source.bit_generator.random_raw(n), np.ones(d)
        steps = (
            splitting_pilot.pilot_steps(state.pilot) if pilot else state.pilot.steps[state.level.number - 1]
        )
        return *state.level.chains.proposed(source, steps), steps

    @staticmethod
    def _counted(state: SplittingState, f: Array) -> SplittingState:
        """The state with the batch and its failures counted."""
        pilot = state.pilot
        if state.phase == "pilot":
            pilot = msgspec.structs.replace(pilot, rollouts=pilot.rollouts + f.size)
        return msgspec.structs.replace(
            state,
            batches=state.batches + 1,
            rollouts=state.rollouts + f.size,
            pilot=pilot,
            failed=state.failed + tuple((state.batches, int(i)) for i in np.flatnonzero(np.isnan(f))),
        )

    @staticmethod
    def _begun(state: SplittingState, u: Array, f: Array, noise: NDArray[np.uint64]) -> SplittingState:
        """The state with the sample of level 0."""
        pilot, size = state.pilot, state.replications.size
        if state.phase == "pilot":
            pilot, size = msgspec.structs.replace(pilot, base_f=f), pilot.size
        chains = Chains(u, f, noise, np.repeat(np.arange(f.size // size), size))
        level = msgspec.structs.replace(state.level, chain_length=1, chains=chains)
        return msgspec.structs.replace(state, pilot=pilot, level=level)

    @staticmethod
    def _moved(state: SplittingState, u: Array, f: Array, noise: NDArray[np.uint64]) -> SplittingState:
        """The state with the chains moved where that stays within the level."""
        level, pilot = state.level, state.pilot
        accepted = f <= pilot.levels[level.number - 1]
        if state.phase == "pilot":
            pilot = splitting_pilot.adapted(pilot, float(np.mean(accepted)), level.chain_length)
        level = msgspec.structs.replace(
            level, chain_length=level.chain_length + 1, chains=level.chains.moved(accepted, u, f, noise)
        )
        return msgspec.structs.replace(state, pilot=pilot, level=level)

    @staticmethod
    def _kept(state: SplittingState) -> SplittingState:
        """The state with the chains' present states in the level's sample.

        In the pilot it takes all of them; later only those that the next level may grow from, but the f of all.
        """
        level, made, new = state.level, state.replications, state.level.chains
        if state.phase != "pilot":
            made = splitting_replications.with_values(made, new)
            new = new.take(new.f <= state.pilot.levels[level.number])
        level = msgspec.structs.replace(level, sample=level.sample.joined(new))
        return msgspec.structs.replace(state, level=level, replications=made)

    # -- from level to level ---------------------------------------------------------------------------------

    def _after_pilot_level(self, state: SplittingState) -> SplittingState:
        """The pilot's next level, or the first group of replications."""
        o, level = self.options, state.level
        pilot, alive = splitting_pilot.next_level(state.pilot, level.number, level.sample, self.gamma, o)
        state = msgspec.structs.replace(state, pilot=pilot)
        if alive is not None:
            source = generator(state.seed, _MOVE_KIND, "estimate", state.batches, 0)
            return self._seeded(state, splitting_pilot.spaced_rows(alive, pilot.size // o.chain, source))
        made = splitting_replications.planned(pilot, o)
        phase = "replications" if made.size else "done"
        return msgspec.structs.replace(state, phase=phase, replications=made, level=self._level_0())

    def _after_level(self, state: SplittingState) -> SplittingState:
        """The next level of the group, the next group, or the end."""
        made, number, survivors = state.replications, state.level.number, state.level.sample
        if number == state.pilot.levels.size - 1 or survivors.size == 0:
            return self._after_group(state)
        made = splitting_replications.next_level(made, survivors, state.pilot.levels[number])
        source = generator(state.seed, _MOVE_KIND, "estimate", state.batches, 0)
        rows = splitting_replications.resampled(
            survivors.replication, made.size // self.options.chain, source
        )
        return self._seeded(msgspec.structs.replace(state, replications=made), rows)

    def _after_group(self, state: SplittingState) -> SplittingState:
        """The next group; or the end, after all replications or where the interim look after half of them suffices."""
        made = state.replications
        complete = (made.group + 1) * made.group_size
        interim = self.options.interim_looks > 1 and complete == made.count // 2
        after = msgspec.structs.replace(
            state, replications=splitting_replications.next_group(made), level=self._level_0()
        )
        over = complete + made.group_size > made.count or (interim and self.estimate(after).converged)
        return msgspec.structs.replace(after, phase="done" if over else "replications")

    def _seeded(self, state: SplittingState, rows: NDArray[np.intp]) -> SplittingState:
        """The next level, with chains that begin at those rows of the present sample."""
        level = LevelState(
            state.level.number + 1, 1, state.level.sample.take(rows), Chains.none(self.base.dim)
        )
        return self._kept(msgspec.structs.replace(state, level=level))

    # -- reports ---------------------------------------------------------------------------------------------

    def _record(
        self, before: SplittingState, after: SplittingState, f: Array, steps: Array
    ) -> TrainingRecord | EstimationRecord:
        if before.phase != "pilot":
            return msgspec.structs.replace(record_of(self.estimate(after)), iteration=before.batches)
        ok = f[~np.isnan(f)]
        number = before.level.number
        bound = before.pilot.levels[number - 1] if number else math.inf
        return TrainingRecord(
            iteration=before.batches,
            rollouts=f.size,
            gamma_k=float(max(self.gamma, bound)),
            quantile=order_statistic(ok, self.options.p0),
            elites=int(np.count_nonzero(f <= bound)),
            ess=float(f.size),
            max_weight_share=1.0 / f.size,
            events=int(np.count_nonzero(f <= self.gamma)),
            infinite=int(np.count_nonzero(f == math.inf)),
            failed=int(f.size - ok.size),
            step=float(np.sqrt(np.mean(steps**2))),
            kl=number * math.log(1.0 / self.options.p0),
            summary={"level": float(number), "acceptance": float(np.mean(f <= bound)) if number else 1.0},
        )

    def _search_warnings(self, state: SplittingState) -> list[EstimateWarning]:
        found: list[EstimateWarning] = []
        if state.phase == "pilot":
            return found
        levels = state.pilot.levels
        if not state.pilot.reached:
            lowest = levels[-2] if levels.size > 1 else math.inf
            found.append(
                EstimateWarning(
                    "threshold-not-reached",
                    f"the pilot's lowest level is {lowest:.4g}, above gamma = {self.gamma:g}: the last step is rarer "
                    "than p0",
                    "a larger budget",
                )
            )
        if state.phase == "done" and state.replications.f.size == 0:
            found.append(
                EstimateWarning(
                    "budget-spent", "the pilot left too little for the replications", "a larger budget"
                )
            )
        return found
