"""Multilevel splitting (subset simulation) with preconditioned Crank-Nicolson moves in standard-normal space.

p = prod_l P(f <= b_{l+1} | f <= b_l),  inf = b_0 > b_1 > ... > b_L = gamma.

A pilot, one adaptive run (Au and Beck, Probabilistic Engineering Mechanics 16, 2001), fixes the levels b_l at its
p0-quantiles and the moves' step sizes (aCS of Papaioannou, Betz, Zwirglmaier and Straub, Prob. Eng. Mech. 41, 2015:
per coordinate in proportion to the spread of the seeds). Then `replications` independent runs with those levels and
steps, none of which adapts anything: each is unbiased for p (Del Moral, Feynman-Kac Formulae, 2004, section 7.4),
so their mean is, and their spread is an honest standard error whatever the chains' correlation.

In a run, level l holds N samples. Those with f <= b_{l+1} are survivors; N / chain of them are chosen by systematic
resampling and each grows a Markov chain of `chain` states: u' = sqrt(1 - s^2) u + s z, coordinatewise, kept where
f(u') <= b_{l+1}. A rollout's own noise is part of its state: a move keeps its seed or draws a fresh one, by turns
of a coin.
"""

import math
from dataclasses import dataclass

import msgspec
import numpy as np
from numpy.typing import ArrayLike, NDArray

from ce.checks import at_least, checked_response, checked_turn, in_range
from ce.errors import BudgetError
from ce.naive import record_of
from ce.posed import Posed
from ce.product import Product
from ce.replicated import ReplicatedEstimate
from ce.results import SAMPLING_SHARE, Condition, FailedRollout
from ce.standard import from_standard
from ce.state import Batch, EstimationRecord, SplittingState, TrainingRecord
from ce.streams import checked_seed, generator
from ce.weights import order_statistic

Array = NDArray[np.float64]

LEAST_BUDGET = 1000
LARGEST_PILOT = 5000  # samples of a level in the pilot
LARGEST_RUN = 10_000  # samples of a level in a replication, above which there are more replications instead
TOGETHER = 20_000  # samples of a level that are held at a time: as many replications side by side
ACCEPTANCE = 0.44  # aimed at by the pilot
_MOVE_KIND = 0x73706C69


@dataclass(frozen=True)
class SplittingOptions:
    """Options of multilevel splitting.

    budget: rollouts at most, pilot included; p0: conditional probability of a level; chain: states of a chain,
    its seed included; replications: independent runs; pilot_share: of the budget, for the pilot at most;
    rel_error: relative half-width to stop at, looked at after half of the replications and after all; each of the two
    looks has half of 1 - confidence (union bound), so that the interval holds whichever of them ends the run.
    """

    budget: int = 100_000
    p0: float = 0.1
    chain: int = 10
    replications: int = 10
    pilot_share: float = 0.4
    rel_error: float | None = None
    confidence: float = 0.95

    def __post_init__(self) -> None:
        at_least("budget", self.budget, 1)
        if self.budget < LEAST_BUDGET:
            raise BudgetError(
                f"method splitting needs a budget of at least {LEAST_BUDGET}, not {self.budget}"
            )
        at_least("chain", self.chain, 2)
        at_least("replications", self.replications, 5)
        in_range("p0", self.p0, 0, 1)
        in_range("pilot_share", self.pilot_share, 0, 1)
        in_range("confidence", self.confidence, 0, 1)
        if self.rel_error is not None:
            in_range("rel_error", self.rel_error, 0, math.inf)

    @property
    def pilot_size(self) -> int:
        """Samples of a level in the pilot: a multiple of chain."""
        return min(max(self.budget // 50 // self.chain, 10), LARGEST_PILOT // self.chain) * self.chain

    def held_rows(self, dim: int) -> int:
        """Rows of `dim` numbers that a state and its open batch hold together at most."""
        return 2 * min(max(TOGETHER, self.pilot_size), self.budget)

    @property
    def looks(self) -> int:
        """At the precision: after half of the replications and after all, or after all only."""
        return 1 if self.rel_error is None else 2


@dataclass(frozen=True)
class Splitting(Posed):
    """The algorithm: pure functions of a frozen state."""

    options: SplittingOptions = SplittingOptions()

    method = "splitting"
    state_kind = SplittingState

    @property
    def total_rollouts(self) -> int:
        """Rollouts at most, the pilot's included."""
        return self.options.budget

    def init(self, seed: int = 0) -> SplittingState:
        """The state before any rollout."""
        d = self.base.dim
        nothing = np.zeros(0)
        return SplittingState(
            digest=self.digest,
            seed=checked_seed(seed),
            phase="pilot",
            batches=0,
            rollouts=0,
            training_rollouts=0,
            size=self.options.pilot_size,
            replications=self.options.replications,
            side_by_side=1,
            group=0,
            level=0,
            position=0,
            levels=nothing,
            steps=np.zeros((0, d)),
            step=0.6,
            chain_u=np.zeros((0, d)),
            chain_f=nothing,
            chain_noise=np.zeros(0, dtype=np.uint64),
            chain_run=np.zeros(0, dtype=np.int64),
            pool_u=np.zeros((0, d)),
            pool_f=nothing,
            pool_noise=np.zeros(0, dtype=np.uint64),
            pool_run=np.zeros(0, dtype=np.int64),
            run_log_p=np.zeros(1),
            accepted=0.0,
            f=nothing,
            log_weights=nothing,
            replication=np.zeros(0, dtype=np.int64),
            base_f=nothing,
            failed=(),
            reached=False,
        )

    def propose(self, state: SplittingState) -> Batch | None:
        """The next batch: a level-0 sample, or one move of every chain. None when finished."""
        if state.phase == "done":
            return None
        u, noise, _ = self._moved(state)
        x = from_standard(self.base, u)
        return Batch(
            "train",
            state.batches,
            x,
            noise,
            self.base.parameters(),
            state.seed,
            0,
            x.shape[0],
            explicit=True,
        )

    def update(
        self, state: SplittingState, batch: Batch, f: ArrayLike
    ) -> tuple[SplittingState, TrainingRecord | EstimationRecord]:
        """The state after the batch was answered with f (n,), NaN = failed rollout, and what happened."""
        checked_turn(batch, state.seed, "train", state.batches, 0)
        values = checked_response(batch, f)
        u, noise, stepped = self._moved(state)
        failed = state.failed + tuple((state.batches, int(i)) for i in np.flatnonzero(np.isnan(values)))
        if state.position == 0 and state.level == 0:
            runs = np.repeat(np.arange(self._runs(state)), state.size)
            after = msgspec.structs.replace(
                state, chain_u=u, chain_f=values, chain_noise=noise, chain_run=runs, accepted=1.0
            )
            if state.phase == "pilot":
                after = msgspec.structs.replace(after, base_f=values)
        else:
            bound = state.levels[state.level - 1]
            taken = values <= bound
            after = msgspec.structs.replace(
                state,
                chain_u=np.where(taken[:, None], u, state.chain_u),
                chain_f=np.where(taken, values, state.chain_f),
                chain_noise=np.where(taken, noise, state.chain_noise),
                accepted=state.accepted + float(np.mean(taken)) / (self.options.chain - 1),
            )
            if state.phase == "pilot":
                gain = 2.0 / math.sqrt(state.position)
                step = state.step * math.exp(gain * (float(np.mean(taken)) - ACCEPTANCE))
                after = msgspec.structs.replace(after, step=min(max(step, 1e-3), 3.0))
        after = msgspec.structs.replace(
            after,
            batches=state.batches + 1,
            rollouts=state.rollouts + values.size,
            training_rollouts=state.training_rollouts + (values.size if state.phase == "pilot" else 0),
            position=state.position + 1,
            failed=failed,
        )
        after = self._kept(after)
        if state.level == 0 or after.position == self.options.chain:
            after = self._next_level(after)
        return after, self._record(state, after, values, stepped)

    def estimate(self, state: SplittingState) -> ReplicatedEstimate:
        """The estimate so far, from the levels completed by the replications; p is NaN during the pilot."""
        return ReplicatedEstimate(
            gamma=self.gamma,
            method=self.method,
            confidence=self.options.confidence,
            rollouts=state.rollouts,
            training_rollouts=state.training_rollouts,
            f=state.f,
            log_weights=state.log_weights,
            proposal=self.base,
            finished=state.phase == "done",
            rel_error=self.options.rel_error,
            failed_rollouts=tuple(FailedRollout("train", k, i) for k, i in state.failed),
            search_warnings=tuple(self._conditions(state)),
            base_f=state.base_f,
            replication=state.replication,
            levels=state.levels,
            spending=1.0 / self.options.looks,
            sampling_share=SAMPLING_SHARE,
        )

    def proposal(self, state: SplittingState) -> Product:
        """The base: what the moves leave as it is."""
        return self.base

    # -- moves -----------------------------------------------------------------------------------------------

    def _runs(self, state: SplittingState) -> int:
        """Replications side by side."""
        return 1 if state.phase == "pilot" else state.side_by_side

    def _moved(self, state: SplittingState) -> tuple[Array, NDArray[np.uint64], Array]:
        """u and noise of the batch, and the step sizes used; a function of the state alone."""
        source = generator(state.seed, _MOVE_KIND, "train", state.batches, 0)
        d = self.base.dim
        if state.level == 0:
            n = self._runs(state) * state.size
            return source.standard_normal((n, d)), source.bit_generator.random_raw(n), np.ones(d)
        n = state.chain_f.size
        z = source.standard_normal((n, d))
        steps = (
            np.minimum(state.step * state.steps[-1], 1.0)
            if state.phase == "pilot"
            else state.steps[state.level - 1]
        )
        fresh = source.random(n) < 0.5
        noise = np.where(fresh, source.bit_generator.random_raw(n), state.chain_noise)
        return np.sqrt(1.0 - steps**2) * state.chain_u + steps * z, noise, steps

    def _kept(self, state: SplittingState) -> SplittingState:
        """The chains' present states added to the level's sample: all of them in the pilot; later only their f, and
        those that the next level may grow from."""
        if state.phase == "pilot":
            keep = np.ones(state.chain_f.size, dtype=bool)
        else:
            keep = state.chain_f <= state.levels[state.level]
            log_w = state.run_log_p[state.chain_run] - math.log(state.size)
            first = state.group * self._runs(state)
            state = msgspec.structs.replace(
                state,
                f=np.concatenate([state.f, state.chain_f]),
                log_weights=np.concatenate([state.log_weights, log_w]),
                replication=np.concatenate([state.replication, first + state.chain_run]),
            )
        return msgspec.structs.replace(
            state,
            pool_u=np.concatenate([state.pool_u, state.chain_u[keep]]),
            pool_f=np.concatenate([state.pool_f, state.chain_f[keep]]),
            pool_noise=np.concatenate([state.pool_noise, state.chain_noise[keep]]),
            pool_run=np.concatenate([state.pool_run, state.chain_run[keep]]),
        )

    def _next_level(self, state: SplittingState) -> SplittingState:
        return self._next_pilot_level(state) if state.phase == "pilot" else self._next_run_level(state)

    def _next_pilot_level(self, state: SplittingState) -> SplittingState:
        o = self.options
        finite = np.where(np.isnan(state.pool_f), math.inf, state.pool_f)
        level = order_statistic(finite, o.p0)
        if not level < math.inf:
            level = float(np.max(finite[finite < math.inf], initial=-math.inf))
        last = state.levels[-1] if state.levels.size else math.inf
        if level >= last:  # a plateau: the highest value below it
            level = float(np.max(finite[finite < last], initial=-math.inf))
        # Settled steps of the level just sampled replace its first guess.
        steps = state.steps
        if state.level:
            steps = np.vstack([steps[:-1], np.minimum(state.step * steps[-1], 1.0)])
        cost = (o.chain - 1) * (state.size // o.chain)
        stuck = not level > -math.inf
        spent = state.rollouts + cost > o.pilot_share * o.budget
        if level <= self.gamma or stuck or spent:
            reached = level <= self.gamma and not stuck
            levels = np.append(state.levels, self.gamma)
            state = msgspec.structs.replace(state, levels=levels, steps=steps, reached=reached)
            return self._first_group(state)
        alive = np.flatnonzero(finite <= level)
        levels = np.append(state.levels, level)
        spread = state.pool_u[alive].std(axis=0) if alive.size > 10 else np.ones(self.base.dim)
        steps = np.vstack([steps, np.clip(spread, 0.05, 1.0)])
        state = msgspec.structs.replace(state, levels=levels, steps=steps, level=state.level + 1)
        return self._seeded(state, alive)

    def _first_group(self, state: SplittingState) -> SplittingState:
        """Replications of equal size that fill the budget that the pilot has left."""
        o = self.options
        moves = (1.0 - 1.0 / o.chain) * (state.levels.size - 1)
        total = (o.budget - state.rollouts) / (1.0 + moves)
        replications = o.replications * max(math.ceil(total / o.replications / LARGEST_RUN), 1)
        each = int(total / replications) // o.chain * o.chain
        size = max(each, o.chain)
        most = max(TOGETHER // size, 1)
        fitting = [
            k for k in range(1, replications // o.looks + 1) if replications // o.looks % k == 0 and k <= most
        ]
        state = msgspec.structs.replace(
            state,
            size=size,
            replications=replications,
            side_by_side=max(fitting),
            phase="run" if each >= o.chain else "done",
        )
        return self._cleared(state)

    def _cleared(self, state: SplittingState) -> SplittingState:
        return msgspec.structs.replace(
            state,
            level=0,
            position=0,
            chain_u=state.chain_u[:0],
            chain_f=state.chain_f[:0],
            chain_noise=state.chain_noise[:0],
            chain_run=state.chain_run[:0],
            pool_u=state.pool_u[:0],
            pool_f=state.pool_f[:0],
            pool_noise=state.pool_noise[:0],
            pool_run=state.pool_run[:0],
            run_log_p=np.zeros(self._runs(state)),
        )

    def _next_run_level(self, state: SplittingState) -> SplittingState:
        o = self.options
        if state.level == state.levels.size - 1 or state.pool_f.size == 0:
            group = state.group + 1
            est = self.estimate(state)
            made = group * state.side_by_side
            at_look = o.looks > 1 and made == state.replications // 2
            done = made + state.side_by_side > state.replications or (at_look and est.converged)
            after = msgspec.structs.replace(state, group=group, phase="done" if done else "run")
            return self._cleared(after)
        # What lies above the next level keeps its weight; what lies below is handed on to the next level's sample.
        bound = state.levels[state.level]
        counts = np.bincount(state.pool_run, minlength=self._runs(state))
        with np.errstate(divide="ignore"):
            run_log_p = state.run_log_p + np.log(counts / state.size)
        mine = state.replication >= state.group * self._runs(state)
        handed = mine & (state.f <= bound)
        state = msgspec.structs.replace(
            state,
            run_log_p=run_log_p,
            level=state.level + 1,
            f=state.f[~handed],
            log_weights=state.log_weights[~handed],
            replication=state.replication[~handed],
        )
        source = generator(state.seed, _MOVE_KIND, "estimate", state.batches, 0)
        seeds = state.size // o.chain
        chosen = []
        for run in np.flatnonzero(counts):  # systematic resampling, each run from its own survivors
            own = source.permutation(np.flatnonzero(state.pool_run == run))
            at = (np.arange(seeds) + source.random()) * own.size / seeds
            chosen.append(own[np.minimum(at.astype(np.intp), own.size - 1)])
        return self._seeded(state, np.concatenate(chosen))

    def _seeded(self, state: SplittingState, rows: NDArray[np.intp]) -> SplittingState:
        """Chains that begin at those rows of the pool; the pool then holds them only."""
        if state.phase == "pilot":
            source = generator(state.seed, _MOVE_KIND, "estimate", state.batches, 0)
            seeds = state.size // self.options.chain
            rows = source.permutation(rows)
            rows = rows[(np.arange(seeds) * rows.size // seeds)]
        state = msgspec.structs.replace(
            state,
            position=1,
            accepted=0.0,
            chain_u=state.pool_u[rows],
            chain_f=state.pool_f[rows],
            chain_noise=state.pool_noise[rows],
            chain_run=state.pool_run[rows],
            pool_u=state.pool_u[:0],
            pool_f=state.pool_f[:0],
            pool_noise=state.pool_noise[:0],
            pool_run=state.pool_run[:0],
        )
        return self._kept(state)

    # -- reports ---------------------------------------------------------------------------------------------

    def _record(
        self, before: SplittingState, after: SplittingState, f: Array, steps: Array
    ) -> TrainingRecord | EstimationRecord:
        if before.phase != "pilot":
            return msgspec.structs.replace(record_of(self.estimate(after)), iteration=before.batches)
        ok = f[~np.isnan(f)]
        bound = before.levels[before.level - 1] if before.level else math.inf
        taken = float(np.mean(f <= bound)) if before.level else 1.0
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
            kl=before.level * math.log(1.0 / self.options.p0),
            summary={"level": float(before.level), "acceptance": taken},
        )

    def _conditions(self, state: SplittingState) -> list[Condition]:
        found: list[Condition] = []
        if state.phase == "pilot":
            return found
        if not state.reached:
            lowest = state.levels[-2] if state.levels.size > 1 else math.inf
            found.append(
                Condition(
                    "threshold-not-reached",
                    f"the pilot's lowest level is {lowest:.4g}, above gamma = {self.gamma:g}: the last step is rarer "
                    "than p0",
                    "a larger budget",
                )
            )
        if state.phase == "done" and state.f.size == 0:
            found.append(
                Condition("budget-spent", "the pilot left too little for the replications", "a larger budget")
            )
        return found
