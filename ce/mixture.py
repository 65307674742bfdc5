"""Adaptive importance sampling with defensive Gaussian mixtures in standard-normal space.

    q_0 = phi (the base)
    for k = 0, 1, ...:
        U_1 .. U_N ~ q_k;  x = T(u)                                                     propose
        gamma_k = max(gamma, min(gamma_{k-1}, rho-quantile of f))                       update: _search_step
        elites = all rollouts so far with f <= gamma_k, weighted by phi / sum_t (N_t / N) q_t
        q_{k+1} = base_share phi + ladder_share (fit of k - 1) + FOUND_SHARE (found by the mode search) + rest (fit)
    until rho of a batch are events, a mode search (`ce.mode_search`) has added what was missed, and at least
    `refinements` more batches have been fitted, as long as that pays
    p = (1/n) sum phi/q(U_i) 1{f_i <= gamma} from fresh samples of the last q

The elites' weights are those of the deterministic mixture of all proposals so far (balance heuristic: Veach and
Guibas, SIGGRAPH 1995; Owen and Zhou, JASA 95, 2000), so no rollout of the search is thrown away while it is an
elite. The estimate itself uses fresh samples only: proposals depend on the earlier ones, and an interval from
all of them would not be honest.
"""

import functools
import math
from dataclasses import dataclass, field

import msgspec
import numpy as np
from numpy.typing import ArrayLike, NDArray

from ce import mode_search
from ce.checks import checked_response, checked_turn
from ce.estimate_warnings import EstimateWarning
from ce.gaussian_mixture import Mixture, Part, draw_standard, log_ratio, mean_log_ratio, only_base
from ce.importance import ImportanceSampling, failed_rows
from ce.mixture_fit import LOW_DIMENSION, fit, fit_clusters
from ce.mixture_options import HIGH_DIMENSION, LEAST_BUDGET, MixtureOptions
from ce.mixture_report import nearest_parameters, record_of_search, search_warnings, summary_of
from ce.mixture_search import (
    FIT_KIND,
    FOUND_SHARE,
    Elites,
    aligned_found,
    chosen_elites,
    directions_of,
    initial_search,
    mode_coverage,
    progressed,
    proposal_of,
)
from ce.product import Product
from ce.records import Batch, EstimationRecord, TrainingRecord
from ce.standard import from_standard
from ce.state import MixtureState
from ce.stopping import first_interim
from ce.streams import generator, noise_seeds
from ce.weights import effective_sample_size, max_share, normalised, order_statistic

__all__ = ["LEAST_BUDGET", "MixtureOptions", "MixtureSampling"]

# Iterations without a lower quantile after which the search ends.
PATIENCE = 3
# Chains of the mode search whose states suffice for a fit.
LEAST_CHAINS = 2
Array = NDArray[np.float64]


@dataclass(frozen=True)
class MixtureSampling(ImportanceSampling[MixtureState], method="mixture", state_type=MixtureState):
    """Mixture sampling as pure functions of a frozen `MixtureState`."""

    options: MixtureOptions = field(default_factory=MixtureOptions)

    def _initial(self, seed: int) -> MixtureState:
        return MixtureState(
            digest=self.digest,
            seed=seed,
            parameters=self.base.parameters(),
            mixtures=(only_base(),),
            search=initial_search(self.base.dim),
        )

    def propose(self, state: MixtureState) -> Batch | None:
        """The next batch, of the search, of the mode search or of the fresh sample; None when finished."""
        if state.phase == "done":
            return None
        u, noise = self._standard(state)
        x = from_standard(self.base, u)
        start = state.sample.f.size
        return Batch(
            phase=_stream_phase(state),
            iteration=state.iteration,
            x=x,
            noise=noise,
            parameters=state.parameters,
            seed=state.seed,
            start=start,
            stop=start + x.shape[0],
            explicit=True,
        )

    def update(
        self, state: MixtureState, batch: Batch, f: ArrayLike
    ) -> tuple[MixtureState, TrainingRecord | EstimationRecord]:
        """The state after the batch was answered with f (n,), NaN = failed rollout, and what happened."""
        checked_turn(batch, state.seed, _stream_phase(state), state.iteration, state.sample.f.size)
        values = checked_response(batch, f)
        u, noise = self._standard(state)
        if state.phase == "train":
            return self._search_step(state, u, values)
        if state.phase == "mode-search":
            return self._mode_search_step(state, u, noise, values)
        return self._estimation_step(state, values, -log_ratio(state.mixtures[-1], u))

    def proposal(self, state: MixtureState) -> Product:
        """The member of the base's family nearest to what is sampled: for reading, not what is sampled."""
        return self.base.with_parameters(state.parameters)

    # -- batches ---------------------------------------------------------------------------------------------

    @property
    def searches_modes_early(self) -> bool:
        """Whether the mode search comes after half of the search at the latest, though gamma may not be reached yet."""
        return self.base.dim <= HIGH_DIMENSION and self.options.mode_search_sizes()[0] > 0

    @property
    def _iteration_size(self) -> int:
        return self.options.iteration_size(self.base.dim)

    @functools.lru_cache(maxsize=1)  # noqa: B019 (one batch, from `propose` to the `update` that answers it)
    def _standard(self, state: MixtureState) -> tuple[Array, NDArray[np.uint64]]:
        """The batch in standard-normal space and its noise, read only; a function of the state, which keeps neither."""
        u, noise = self._drawn(state)
        u.setflags(write=False)
        noise.setflags(write=False)
        return u, noise

    def _drawn(self, state: MixtureState) -> tuple[Array, NDArray[np.uint64]]:
        if state.phase == "mode-search":
            assert state.search.mode_search is not None
            hot, _ = self.options.mode_search_sizes()
            return mode_search.propose(state.search.mode_search, hot, state.seed, state.iteration)
        phase, start, stop = state.phase, 0, self._iteration_size
        if phase == "estimate":
            start = state.sample.f.size
            stop = min(start + self.options.batch_size, state.sample.interim_at)
        u = draw_standard(state.mixtures[-1], self.base.dim, state.seed, phase, state.iteration, start, stop)
        return u, noise_seeds(state.seed, phase, state.iteration, start, stop)

    # -- the search ------------------------------------------------------------------------------------------

    def _search_step(self, state: MixtureState, u: Array, f: Array) -> tuple[MixtureState, TrainingRecord]:
        """Elites, progress, fit and record of one iteration, and what comes next."""
        current = state.mixtures[-1]
        ratio = log_ratio(current, u)
        quantile = order_statistic(f[~np.isnan(f)], self.options.rho)
        elites = chosen_elites(state, u, f, quantile, self.gamma, self.options)
        search = progressed(state.search, elites, f, ratio, quantile, len(state.mixtures), self.gamma)
        after = msgspec.structs.replace(
            state,
            iteration=state.iteration + 1,
            search=search,
            failed=state.failed + failed_rows(state.iteration, f),
            base_f=f if state.iteration == 0 else state.base_f,
        )
        after = self._fitted(self._with_aligned(after, current, u, f), search.found, elites, u, f)
        record = msgspec.structs.replace(
            record_of_search(
                self.gamma,
                state.iteration,
                f,
                elites.level,
                quantile,
                float(np.mean(ratio)),
                summary_of(current),
            ),
            elites=int(elites.f.size),
            ess=effective_sample_size(elites.log_weights),
            max_weight_share=max_share(elites.log_weights),
            step=1.0 if elites.f.size >= 2 else 0.0,
        )
        return self._next_phase(msgspec.structs.replace(after, records=(*state.records, record))), record

    def _with_aligned(self, state: MixtureState, current: Mixture, u: Array, f: Array) -> MixtureState:
        """The state with what the mode search found aligned, if u (n, d) is the first batch that was drawn from it."""
        found = state.search.found
        just_found = bool(state.records) and "mode_search" in state.records[-1].summary
        if found is None or not just_found or not LOW_DIMENSION < self.base.dim <= HIGH_DIMENSION:
            return state
        search = msgspec.structs.replace(state.search, found=aligned_found(found, current, u, f))
        return msgspec.structs.replace(state, search=search)

    def _fitted(
        self, state: MixtureState, before: Part | None, elites: Elites, u: Array, f: Array
    ) -> MixtureState:
        """The state with the proposal fitted to the elites; with the last one again where they are too few."""
        current, search = state.mixtures[-1], state.search
        if elites.f.size < 2:
            return msgspec.structs.replace(state, mixtures=(*state.mixtures, current))
        source = generator(state.seed, FIT_KIND, "train", state.iteration - 1, 0)
        directions = directions_of(current, u, f, elites)
        part = fit(elites.u, normalised(elites.log_weights), self.options.components, source, directions)
        search = msgspec.structs.replace(search, fits=(*search.fits, part)[-2:])
        state = msgspec.structs.replace(state, search=search)
        return self._with_proposal(state, state.mixtures, elites.log_weights, search.found is not before)

    def _with_proposal(
        self, state: MixtureState, before: tuple[Mixture, ...], log_w: Array, first: bool
    ) -> MixtureState:
        """The state with the proposal made of its last fits, log_w being its elites' weights, after those before."""
        search = state.search
        return msgspec.structs.replace(
            state,
            mixtures=(*before, proposal_of(search, log_w, first, self.options)),
            parameters=nearest_parameters(self.base, search.elite_u, normalised(log_w), search.fits[-1]),
        )

    def _next_phase(self, state: MixtureState) -> MixtureState:
        """After an iteration of the search: more of it, the mode search, or the fresh sample."""
        if self._modes_are_due(state):
            bound = self.gamma if state.search.reached_at >= 0 else math.inf
            search = msgspec.structs.replace(state.search, mode_search=mode_search.init(self.base.dim, bound))
            return msgspec.structs.replace(state, phase="mode-search", search=search)
        return self._begin_estimation(state) if self._search_is_over(state) else state

    def _modes_are_due(self, state: MixtureState) -> bool:
        """Whether the mode search is to begin, or to begin again where it has met no event before gamma was reached."""
        hot, _ = self.options.mode_search_sizes()
        search, last = state.search, state.search.mode_search
        made, most = len(state.mixtures) - 1, self.options.most_iterations(self.base.dim)
        missed = last is not None and last.chains.size == 0 and last.bound > self.gamma
        slow = made >= most // 2 or made > search.improved_at + PATIENCE
        early = last is None and slow and self.searches_modes_early
        return hot > 0 and (early or (search.reached_at >= 0 and (last is None or missed)))

    def _search_is_over(self, state: MixtureState) -> bool:
        """Whether another iteration would cost more effective events than it is expected to gain, or may not be."""
        search = state.search
        made, most = len(state.mixtures) - 1, self.options.most_iterations(self.base.dim)
        reached = search.reached_at >= 0
        over = made >= most or (not reached and made > search.improved_at + PATIENCE)
        refined = made - max(search.reached_at, 1)
        if over or not reached or refined < self.options.refinements:
            return over
        rates, limit = search.ess_rates, self._estimation_limit(state)
        before, last = rates[-2:] if len(rates) > 1 else (0.0, rates[-1])
        # Half of the last gain again, for what one more iteration takes from the fresh sample.
        return (last + 0.5 * (last - before)) * (limit - self._iteration_size) <= last * limit

    def _begin_estimation(self, state: MixtureState) -> MixtureState:
        """The state before the first batch of the fresh sample, without what only the search needs."""
        o, limit = self.options, self._estimation_limit(state)
        interim_at = first_interim(o.rel_error, limit, o.batch_size)
        return msgspec.structs.replace(
            state,
            phase="estimate",
            iteration=0,
            mode_coverage=mode_coverage(state),
            search=msgspec.structs.replace(state.search, elite_u=state.search.elite_u[:0], mode_search=None),
            sample=msgspec.structs.replace(state.sample, interim_at=interim_at),
        )

    # -- the mode search -------------------------------------------------------------------------------------

    def _mode_search_step(
        self, state: MixtureState, u: Array, noise: NDArray[np.uint64], f: Array
    ) -> tuple[MixtureState, TrainingRecord]:
        """A batch of the mode search answered; after the last one, what it has found is a part of the proposal."""
        asked = state.search.mode_search
        assert asked is not None
        _, chains = self.options.mode_search_sizes()
        made = mode_search.update(asked, u, noise, f, self.gamma, chains, state.seed, state.iteration)
        summary = {"mode_search": float(asked.step), "chains": float(made.chains.size)}
        quantile = order_statistic(f[~np.isnan(f)], self.options.rho)
        record = record_of_search(self.gamma, state.iteration, f, state.search.level, quantile, 0.0, summary)
        after = msgspec.structs.replace(
            state,
            phase="train" if made.over else state.phase,
            iteration=state.iteration + 1,
            search=msgspec.structs.replace(state.search, mode_search=made),
            failed=state.failed + failed_rows(state.iteration, f),
            records=(*state.records, record),
        )
        if not made.over or made.visited.shape[0] < mode_search.KEPT_MOVES * LEAST_CHAINS:
            return after, record
        return self._with_found(after, made), record

    def _with_found(self, state: MixtureState, made: mode_search.ModeSearch) -> MixtureState:
        """The state with a fit to the states visited, and with it in the proposal in place of the last one."""
        source = generator(state.seed, FIT_KIND, "train", state.iteration - 1, 1)
        labels = np.tile(np.arange(made.chains.size), mode_search.KEPT_MOVES)
        ess_limit = mode_search.ESS_OF_A_CHAIN * made.chains.size
        part = fit_clusters(made.visited, labels, self.options.components, source, ess_limit)
        state = msgspec.structs.replace(state, search=msgspec.structs.replace(state.search, found=part))
        before = state.mixtures[:-1]
        if state.search.fits:
            log_w = -mean_log_ratio(before, state.search.elite_u)
            return self._with_proposal(state, before, log_w, self.base.dim <= HIGH_DIMENSION)
        mixture = Mixture(1.0 - FOUND_SHARE, (msgspec.structs.replace(part, weight=FOUND_SHARE),))
        return msgspec.structs.replace(state, mixtures=(*before, mixture))

    # -- what an importance sampler has to say ---------------------------------------------------------------

    def _sampled(self, state: MixtureState) -> Product:
        return self.proposal(state)

    def _estimation_limit(self, state: MixtureState) -> int:
        return self.options.budget - sum(record.rollouts for record in state.records)

    def _mode_coverage(self, state: MixtureState) -> float:
        return state.mode_coverage

    def _search_warnings(self, state: MixtureState) -> list[EstimateWarning]:
        return search_warnings(state, self.gamma, self.options.rho, self._iteration_size)


def _stream_phase(state: MixtureState) -> str:
    """The phase of the stream that the next batch belongs to."""
    return "estimate" if state.phase == "estimate" else "train"
