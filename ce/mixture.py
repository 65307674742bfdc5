"""Adaptive importance sampling with defensive Gaussian mixtures in standard-normal space.

    q_0 = phi (the base)
    for k = 0, 1, ...:
        U_1 .. U_N ~ q_k;  x = T(u)                                                     propose
        gamma_k = max(gamma, min(gamma_{k-1}, rho-quantile of f))                       update: _search_step
        elites = all rollouts so far with f <= gamma_k, weighted by phi / sum_t (N_t / N) q_t
        q_{k+1} = base_share phi + ladder_share (fit of k - 1) + FOUND_SHARE (what the look found) + rest (fit)
    until rho of a batch are events, a look from elsewhere (`ce.look`) has added what was missed, and at least
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
from typing import Any

import msgspec
import numpy as np
from numpy.typing import ArrayLike, NDArray

from ce import look
from ce.checks import checked_response, checked_turn
from ce.gaussian_mixture import Mixture, Part, draw_standard, log_ratio, nearest, only_base
from ce.headway import headway
from ce.importance import ImportanceSampling
from ce.mixture_fit import FEW, fit, fit_clusters, straightened
from ce.mixture_options import LEAST_BUDGET, MANY, MOST_ELITES, MixtureOptions
from ce.mixture_report import LEAST_ELITES, described, record_of_search, search_conditions, summary_of
from ce.product import Product
from ce.regression import Direction, downhill
from ce.results import Condition
from ce.standard import from_standard
from ce.state import Batch, EstimationRecord, MixtureState, TrainingRecord
from ce.stopping import first_look
from ce.streams import checked_seed, generator, noise_seeds
from ce.subspace import LARGEST_FREE
from ce.weights import effective_sample_size, max_share, normalised, order_statistic

__all__ = ["LEAST_BUDGET", "MixtureOptions", "MixtureSampling"]

ENOUGH_TO_JUMP = 40.0  # effective events
ENOUGH_ELITES = 200.0  # effective, however large an iteration is
PATIENCE = 3  # iterations without a lower quantile after which the search ends
FOUND_FIRST, FOUND_SHARE = (
    0.4,
    0.1,
)  # of what the look has found: in the proposal after it, and in those that follow
MOST_HINTS = 8
LEAST_MASS = 0.01  # of the event, below which it does not matter whether a part of it is covered
LEAST_STATES = 2  # chains
_FIT_KIND = 0x66697400
Array = NDArray[np.float64]


@dataclass(frozen=True)
class MixtureSampling(ImportanceSampling):
    """The algorithm: pure functions of a frozen state."""

    options: MixtureOptions = field(default_factory=MixtureOptions)

    method = "mixture"
    state_kind = MixtureState

    @property
    def total_rollouts(self) -> int:
        """Rollouts at most, training included."""
        return self.options.budget

    def init(self, seed: int = 0) -> MixtureState:
        """The state before any rollout: the first proposal is the base."""
        nothing = np.zeros(0)
        return MixtureState(
            digest=self.digest,
            seed=checked_seed(seed),
            phase="train",
            iteration=0,
            mixtures=(only_base(),),
            fits=(),
            parameters=self.base.parameters(),
            level=math.inf,
            least_quantile=math.inf,
            reached_at=-1,
            improved_at=0,
            elite_u=np.zeros((0, self.base.dim)),
            elite_f=nothing,
            look=None,
            found=None,
            coverage=math.nan,
            worths=(),
            headway=(),
            shares=(),
            records=(),
            failed=(),
            f=nothing,
            log_weights=nothing,
            base_f=nothing,
            look_at=0,
        )

    def propose(self, state: MixtureState) -> Batch | None:
        """The next batch: an iteration of the search, a part of the look or of the fresh sample; None when finished."""
        if state.phase == "done":
            return None
        u, noise = self._standard(state)
        x = from_standard(self.base, u)
        phase = "estimate" if state.phase == "estimate" else "train"
        start = self._start(state)
        return Batch(
            phase,
            state.iteration,
            x,
            noise,
            state.parameters,
            state.seed,
            start,
            start + x.shape[0],
            explicit=True,
        )

    def update(
        self, state: MixtureState, batch: Batch, f: ArrayLike
    ) -> tuple[MixtureState, TrainingRecord | EstimationRecord]:
        """The state after the batch was answered with f (n,), NaN = failed rollout, and what happened."""
        phase = "estimate" if state.phase == "estimate" else "train"
        checked_turn(batch, state.seed, phase, state.iteration, self._start(state))
        values = checked_response(batch, f)
        u, noise = self._standard(state)
        if state.phase == "train":
            return self._search_step(state, u, values)
        if state.phase == "look":
            return self._look_step(state, u, noise, values)
        return self._estimation_step(state, values, -log_ratio(state.mixtures[-1], u))

    def proposal(self, state: MixtureState) -> Product:
        """The member of the base's family nearest to what is sampled: for reading, not what is sampled."""
        return self.base.with_parameters(state.parameters)

    # -- batches ---------------------------------------------------------------------------------------------

    @property
    def looks_early(self) -> bool:
        """Whether the look comes after half of the search at the latest, though gamma may not be reached by then."""
        return self.base.dim <= MANY and self.options.look_sizes()[0] > 0

    @property
    def _iteration_size(self) -> int:
        return self.options.iteration_size(self.base.dim)

    def _start(self, state: MixtureState) -> int:
        return state.f.size if state.phase == "estimate" else 0

    @functools.lru_cache(maxsize=1)  # noqa: B019 (one batch, from `propose` to the `update` that answers it)
    def _standard(self, state: MixtureState) -> tuple[Array, NDArray[np.uint64]]:
        """The batch in standard-normal space and its noise, read only: a function of the state, which does not keep
        them."""
        u, noise = self._drawn(state)
        u.setflags(write=False)
        noise.setflags(write=False)
        return u, noise

    def _drawn(self, state: MixtureState) -> tuple[Array, NDArray[np.uint64]]:
        if state.phase == "look":
            assert state.look is not None
            return look.batch(state.look, self.options.look_sizes()[0], state.seed, state.iteration)
        phase, start, stop = state.phase, 0, self._iteration_size
        if phase == "estimate":
            start = state.f.size
            stop = min(start + self.options.batch_size, state.look_at)
        u = draw_standard(state.mixtures[-1], self.base.dim, state.seed, phase, state.iteration, start, stop)
        return u, noise_seeds(state.seed, phase, state.iteration, start, stop)

    # -- the search ------------------------------------------------------------------------------------------

    def _search_step(self, state: MixtureState, u: Array, f: Array) -> tuple[MixtureState, TrainingRecord]:
        o = self.options
        ok = np.flatnonzero(~np.isnan(f))
        quantile = order_statistic(f[ok], o.rho)
        # All that may be an elite, from which the lowest level is chosen that enough of them, by weight, are below.
        top = (
            state.level
            if state.level < math.inf
            else (quantile if quantile < math.inf else _largest_finite(f))
        )
        new = ok[f[ok] <= max(top, self.gamma)]
        older = state.elite_f.size
        pool_f = np.concatenate([state.elite_f, f[new]])
        pool_u = np.concatenate([state.elite_u, u[new]])
        pool_log_w = -_mean_log_ratio(state.mixtures, pool_u)
        level = self._lowered(pool_f, pool_log_w, max(top, self.gamma))
        kept = np.flatnonzero(pool_f <= level)
        if kept.size > MOST_ELITES:
            source = generator(state.seed, _FIT_KIND, "train", state.iteration, 2)
            kept = np.sort(source.permutation(kept)[:MOST_ELITES])
        older, new = int(np.count_nonzero(kept < older)), new[kept[kept >= older] - older]
        elite_u, elite_f, log_w = pool_u[kept], pool_f[kept], pool_log_w[kept]
        current = state.mixtures[-1]
        ratio = log_ratio(current, u)
        fits_made = len(state.mixtures)
        reached = state.reached_at >= 0 or level <= self.gamma
        worths = state.worths
        if reached:
            worths = (*worths, effective_sample_size(-ratio[f <= self.gamma]) / f.size)
        ahead = headway(f, -ratio, state.level)
        share = float(np.exp(-ratio[f <= self.gamma]).sum()) / f.size
        improved = quantile < state.least_quantile
        after = msgspec.structs.replace(
            state,
            iteration=state.iteration + 1,
            level=level,
            least_quantile=quantile if improved else state.least_quantile,
            reached_at=fits_made if reached and state.reached_at < 0 else state.reached_at,
            improved_at=fits_made if improved else state.improved_at,
            elite_u=elite_u,
            elite_f=elite_f,
            worths=worths,
            headway=(*state.headway, ahead),
            shares=(*state.shares, share),
            failed=_with_failures(state, f),
            base_f=f if state.iteration == 0 else state.base_f,
        )
        just_found = bool(state.records) and "look" in state.records[-1].summary
        if just_found and state.found is not None and FEW < self.base.dim <= MANY:
            after = msgspec.structs.replace(after, found=_straightened(state.found, current, u, f))
        fitted = elite_f.size >= 2
        if fitted:
            source = generator(state.seed, _FIT_KIND, "train", state.iteration, 0)
            hints = _hints(current, u, f, older, new)
            part = fit(elite_u, normalised(log_w), o.components, source, hints)
            after = self._with_fit(
                after, (*state.fits, part)[-2:], log_w, first=after.found is not state.found
            )
        else:
            after = msgspec.structs.replace(after, mixtures=(*state.mixtures, current))
        record = record_of_search(
            self.gamma, state, f, level, quantile, float(np.mean(ratio)), summary_of(current)
        )
        record = msgspec.structs.replace(
            record,
            elites=int(elite_f.size),
            ess=effective_sample_size(log_w),
            max_weight_share=max_share(log_w),
            step=1.0 if fitted else 0.0,
        )
        return self._next_phase(msgspec.structs.replace(after, records=(*state.records, record))), record

    def _lowered(self, f: Array, log_w: Array, top: float) -> float:
        """The lowest level, from gamma to `top`, below which the values f (n,) are worth enough for a fit; gamma
        itself where the events are worth ENOUGH_TO_JUMP, which in many dimensions is not enough for a fit."""
        all_elites = self.options.rho * self._iteration_size
        needed = min(all_elites, max(LEAST_ELITES, min(0.6 * all_elites, ENOUGH_ELITES)))
        jump = min(needed, ENOUGH_TO_JUMP) if self.base.dim <= MANY else needed
        if effective_sample_size(log_w[f <= self.gamma]) >= jump:
            return self.gamma
        order = np.argsort(f)
        w = np.exp(log_w[order] - np.max(log_w, initial=-math.inf))
        with np.errstate(invalid="ignore"):
            worth = np.cumsum(w) ** 2 / np.cumsum(w * w)
        enough = np.flatnonzero(worth >= needed * (1.0 - 1e-9))
        if enough.size == 0 or (first := f[order[enough[0]]]) > top:
            return top
        return max(float(first), self.gamma)

    def _with_fit(
        self, state: MixtureState, fits: tuple[Part, ...], log_w: Array, first: bool = False
    ) -> MixtureState:
        """The state with a proposal made of the last fits, what the look found (first: just now, in few enough
        dimensions that its rows will tell where f falls, or brought back to there just now), and the base."""
        o = self.options
        poor = effective_sample_size(log_w) < LEAST_ELITES
        share = FOUND_FIRST if first or poor else FOUND_SHARE
        parts = []
        if len(fits) > 1 and o.ladder_share:
            parts.append(msgspec.structs.replace(fits[-2], weight=o.ladder_share))
        if state.found is not None:
            parts.append(msgspec.structs.replace(state.found, weight=share))
        rest = 1.0 - o.base_share - sum(part.weight for part in parts)
        mixture = Mixture(o.base_share, (msgspec.structs.replace(fits[-1], weight=rest), *parts))
        return msgspec.structs.replace(
            state,
            fits=fits,
            mixtures=(*state.mixtures, mixture),
            parameters=described(self.base, state.elite_u, normalised(log_w), fits[-1]),
        )

    def _next_phase(self, state: MixtureState) -> MixtureState:
        """After an iteration of the search: more of it, the look, or the fresh sample."""
        o = self.options
        made, most = len(state.mixtures) - 1, o.most_iterations(self.base.dim)
        reached = state.reached_at >= 0
        hot, _ = o.look_sizes()
        missed = state.look is not None and state.look.f.size == 0 and state.look.bound > self.gamma
        slow = made >= most // 2 or made > state.improved_at + PATIENCE
        early = state.look is None and slow and self.looks_early
        if hot and (early or (reached and (state.look is None or missed))):
            begun = look.begun(self.base.dim, self.gamma if reached else math.inf)
            return msgspec.structs.replace(state, phase="look", look=begun)
        limit = o.budget - sum(record.rollouts for record in state.records)
        refined = made - max(state.reached_at, 1)
        over = made >= most or (not reached and made > state.improved_at + PATIENCE)
        if reached and refined >= o.refinements:
            before, last = state.worths[-2:] if len(state.worths) > 1 else (0.0, state.worths[-1])
            # Half of the last gain again, for what one more iteration takes from the fresh sample.
            over = over or (last + 0.5 * (last - before)) * (limit - self._iteration_size) <= last * limit
        if not over:
            return state
        return msgspec.structs.replace(
            state,
            phase="estimate",
            iteration=0,
            elite_u=state.elite_u[:0],
            coverage=self._coverage(state),
            look=None,
            look_at=first_look(o.rel_error, limit, o.batch_size),
        )

    # -- the look --------------------------------------------------------------------------------------------

    def _look_step(
        self, state: MixtureState, u: Array, noise: NDArray[np.uint64], f: Array
    ) -> tuple[MixtureState, TrainingRecord]:
        assert state.look is not None
        wanted = self.options.look_sizes()[1]
        seen = look.answered(state.look, u, noise, f, self.gamma, wanted, state.seed, state.iteration)
        summary = {"look": float(state.look.step), "chains": float(seen.f.size)}
        quantile = order_statistic(f[~np.isnan(f)], self.options.rho)
        record = record_of_search(self.gamma, state, f, state.level, quantile, 0.0, summary)
        after = msgspec.structs.replace(
            state,
            iteration=state.iteration + 1,
            look=seen,
            failed=_with_failures(state, f),
            records=(*state.records, record),
        )
        if not seen.over:
            return after, record
        after = msgspec.structs.replace(after, phase="train")
        if seen.seen.shape[0] < look.KEPT_MOVES * LEAST_STATES:
            return after, record
        source = generator(state.seed, _FIT_KIND, "train", state.iteration, 1)
        chains = np.tile(np.arange(seen.f.size), look.KEPT_MOVES)
        part = fit_clusters(seen.seen, chains, self.options.components, source, look.WORTH * seen.f.size)
        after = msgspec.structs.replace(after, found=part)
        if state.fits:
            log_w = -_mean_log_ratio(state.mixtures[:-1], state.elite_u)
            after = self._with_fit(after, state.fits, log_w, first=self.base.dim <= MANY)
            after = msgspec.structs.replace(after, mixtures=(*state.mixtures[:-1], after.mixtures[-1]))
        else:
            mixture = Mixture(1.0 - FOUND_SHARE, (msgspec.structs.replace(part, weight=FOUND_SHARE),))
            after = msgspec.structs.replace(after, mixtures=(*state.mixtures[:-1], mixture))
        return after, record

    def _coverage(self, state: MixtureState) -> float:
        """Share of the look's states that the last fits cover, what the look found left out; 1 where the elites that
        they do not cover carry less than LEAST_MASS of the event."""
        if state.look is None or not state.look.seen.size:
            return math.nan
        last = state.mixtures[-1]
        if state.found is not None:
            last = Mixture(last.base_share, last.parts[:-1])
        elite_log_w = -_mean_log_ratio(state.mixtures[:-1], state.elite_u)
        missed = look.uncovered(-log_ratio(last, state.elite_u), elite_log_w)
        if float(normalised(elite_log_w)[missed].sum()) < LEAST_MASS:
            return 1.0
        return 1.0 - float(np.mean(look.uncovered(-log_ratio(last, state.look.seen), elite_log_w)))

    # -- what an importance sampler has to say -----------------------------------------------------------------

    def _sampled(self, state: MixtureState) -> Product:
        return self.proposal(state)

    def _estimation_limit(self, state: MixtureState) -> int:
        return self.options.budget - sum(record.rollouts for record in state.records)

    def _extra(self, state: MixtureState) -> dict[str, Any]:
        return {"mode_coverage": state.coverage}

    def _search_conditions(self, state: MixtureState) -> list[Condition]:
        return search_conditions(state, self.gamma, self.options.rho, self._iteration_size)


def _hints(mixture: Mixture, u: Array, f: Array, older: int, new: NDArray[np.intp]) -> list[Direction]:
    """Where f falls, around each component of the mixture that u (n, d) was drawn from and has enough rows for it, and
    over all; for the elites, which are `older` ones before the rows `new`. Surest first."""
    if u.shape[1] <= LARGEST_FREE:
        return []
    label = nearest(mixture, u)
    groups = [np.arange(u.shape[0])]
    groups += [np.flatnonzero(label == j) for j in range(label.max() + 1)] if label.max() > 0 else []
    found = []
    for rows in groups:
        direction = downhill(u[rows], f[rows], np.flatnonzero(np.isin(rows, new)))
        if direction is None:
            continue
        own = np.zeros(u.shape[0])
        own[rows] = direction.own
        own = np.concatenate([np.zeros(older), own[new]])
        found.append(Direction(direction.vector, own, direction.cosine2))
    return sorted(found, key=lambda hint: -hint.cosine2)[:MOST_HINTS]


def _straightened(found: Part, sampled: Mixture, u: Array, f: Array) -> Part:
    """What the look found, by what the first batch that was drawn from it tells."""
    label = nearest(sampled, u) - (1 + sum(part.shares.size for part in sampled.parts[:-1]))
    return straightened(found, np.maximum(label, -1), u, f)


def _with_failures(state: MixtureState, f: Array) -> tuple[tuple[int, int], ...]:
    return state.failed + tuple((state.iteration, int(i)) for i in np.flatnonzero(np.isnan(f)))


def _largest_finite(f: Array) -> float:
    return float(np.max(f[np.isfinite(f)], initial=-math.inf)) if np.isfinite(f).any() else math.inf


def _mean_log_ratio(mixtures: tuple[Mixture, ...], u: Array) -> Array:
    """log of the mean over the iterations of q_t / phi, (n,)."""
    total = np.zeros(u.shape[0])
    for count, mixture in enumerate(mixtures):
        ratio = log_ratio(mixture, u)
        total = ratio if count == 0 else np.logaddexp(total, ratio)
    return total - math.log(len(mixtures))
