"""Adaptive importance sampling with defensive Gaussian mixtures in standard-normal space.

    q_0 = phi (the base)
    for k = 0, 1, ...:
        U_1 .. U_N ~ q_k;  x = T(u)                                                     propose
        gamma_k = max(gamma, min(gamma_{k-1}, rho-quantile of f))                       update: _search_step
        elites = all rollouts so far with f <= gamma_k, weighted by phi / sum_t (N_t / N) q_t
        q_{k+1} = base_share phi + ladder_share (fit of k - 1) + rest (fit to the elites)
    until rho of a batch are events and `refinements` more batches have been fitted
    p = (1/n) sum phi/q(U_i) 1{f_i <= gamma} from fresh samples of the last q

The elites' weights are those of the deterministic mixture of all proposals so far (balance heuristic: Veach and
Guibas, SIGGRAPH 1995; Owen and Zhou, JASA 95, 2000), so no rollout of the search is thrown away while it is an
elite. The estimate itself uses fresh samples only: proposals depend on the earlier ones, and an interval from
all of them would not be honest.
"""

import math
from dataclasses import dataclass

import msgspec
import numpy as np
from numpy.typing import ArrayLike, NDArray

from ce import beta_update
from ce.checks import at_least, checked_response, checked_turn, in_range
from ce.errors import BudgetError
from ce.gaussian_mixture import Mixture, Part, draw_standard, log_ratio, only_base
from ce.mixture_fit import fit
from ce.naive import record_of
from ce.posed import Posed
from ce.product import Product
from ce.results import Condition, Estimate, FailedRollout
from ce.standard import from_standard
from ce.state import Batch, EstimationRecord, MixtureState, TrainingRecord
from ce.stopping import next_look
from ce.streams import checked_seed, generator, noise_seeds
from ce.subspace import LARGEST_FREE
from ce.weights import effective_sample_size, max_share, normalised, order_statistic

LEAST_BUDGET = 1000
SAFE_SIZE = 1000  # rollouts in an iteration below which modes were seen to be missed (README, "Measured")
LEAST_ELITES = 100
PATIENCE = 3  # iterations without a lower quantile after which the search ends
_FIT_KIND = 0x66697400
Array = NDArray[np.float64]


@dataclass(frozen=True)
class MixtureOptions:
    """Options of mixture sampling.

    budget: rollouts at most, training included; rho: quantile level; samples_per_iteration: of the search (None: a
    twentieth of the budget, a twelfth in more than LARGEST_FREE dimensions, at most 10,000, and at least SAFE_SIZE
    where a tenth of the budget allows it); search_share: of
    the budget that the search may use; refinements: batches fitted after the threshold is reached; base_share: of
    the base in every proposal, which bounds every weight by 1 / base_share; ladder_share: of the fit before the
    last; components: at most, in a fit; rel_error: relative half-width to stop at (None: spend the budget);
    batch_size: estimation rollouts in a batch.
    """

    budget: int = 100_000
    rho: float = 0.1
    samples_per_iteration: int | None = None
    search_share: float = 0.6
    refinements: int = 2
    base_share: float = 0.1
    ladder_share: float = 0.1
    components: int = 12
    rel_error: float | None = None
    confidence: float = 0.95
    batch_size: int = 5000

    def __post_init__(self) -> None:
        at_least("budget", self.budget, 1)
        if self.budget < LEAST_BUDGET:
            raise BudgetError(f"method mixture needs a budget of at least {LEAST_BUDGET}, not {self.budget}")
        at_least("refinements", self.refinements, 0)
        at_least("components", self.components, 1)
        at_least("batch_size", self.batch_size, 1)
        in_range("rho", self.rho, 0, 1)
        in_range("search_share", self.search_share, 0, 1)
        in_range("base_share", self.base_share, 0, 0.5)
        if self.ladder_share != 0:
            in_range("ladder_share", self.ladder_share, 0, 0.5)
        in_range("confidence", self.confidence, 0, 1)
        if self.rel_error is not None:
            in_range("rel_error", self.rel_error, 0, math.inf)
        if self.samples_per_iteration is not None:
            at_least("samples_per_iteration", self.samples_per_iteration, 50)
            if self.samples_per_iteration > self.search_share * self.budget:
                raise BudgetError(
                    f"one iteration of {self.samples_per_iteration} rollouts does not fit into the search's share "
                    f"of a budget of {self.budget}"
                )

    def iteration_size(self, dim: int) -> int:
        """Rollouts in an iteration of the search."""
        part = 20 if dim <= LARGEST_FREE else 12
        least = min(SAFE_SIZE, max(self.budget // 10, 200))
        return self.samples_per_iteration or min(max(self.budget // part, least), 10_000)

    def most_iterations(self, dim: int) -> int:
        return max(int(self.search_share * self.budget) // self.iteration_size(dim), 1)


@dataclass(frozen=True)
class MixtureSampling(Posed):
    """The algorithm: pure functions of a frozen state."""

    options: MixtureOptions = MixtureOptions()

    method = "mixture"
    state_kind = MixtureState

    @property
    def total_rollouts(self) -> int:
        """Rollouts at most, training included."""
        return self.options.budget

    def init(self, seed: int = 0) -> MixtureState:
        """The state before any rollout: the first proposal is the base."""
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
            elite_f=np.zeros(0),
            records=(),
            failed=(),
            f=np.zeros(0),
            log_weights=np.zeros(0),
            base_f=np.zeros(0),
            look_at=0,
        )

    def propose(self, state: MixtureState) -> Batch | None:
        """The next batch: one iteration of the search, or part of the fresh sample. None when finished."""
        if state.phase == "done":
            return None
        start, stop = self._rows(state)
        x = from_standard(self.base, self._standard(state))
        noise = noise_seeds(state.seed, state.phase, state.iteration, start, stop)
        return Batch(
            state.phase, state.iteration, x, noise, state.parameters, state.seed, start, stop, explicit=True
        )

    def update(
        self, state: MixtureState, batch: Batch, f: ArrayLike
    ) -> tuple[MixtureState, TrainingRecord | EstimationRecord]:
        """The state after the batch was answered with f (n,), NaN = failed rollout, and what happened."""
        checked_turn(batch, state.seed, state.phase, state.iteration, self._rows(state)[0])
        values = checked_response(batch, f)
        if state.phase == "train":
            return self._search_step(state, values)
        return self._estimation_step(state, values)

    def estimate(self, state: MixtureState) -> Estimate:
        """The estimate so far; p is NaN until estimation rollouts have been answered."""
        training = sum(record.rollouts for record in state.records)
        failures = [FailedRollout("train", k, i) for k, i in state.failed]
        failures += [FailedRollout("estimate", 0, int(i)) for i in np.flatnonzero(np.isnan(state.f))]
        return Estimate(
            gamma=self.gamma,
            method=self.method,
            confidence=self.options.confidence,
            rollouts=training + state.f.size,
            training_rollouts=training,
            f=state.f,
            log_weights=state.log_weights,
            proposal=self.proposal(state),
            finished=state.phase == "done",
            rel_error=self.options.rel_error,
            failed_rollouts=tuple(failures),
            search_warnings=tuple(self._search_conditions(state)),
            base_f=state.base_f,
        )

    def proposal(self, state: MixtureState) -> Product:
        """The member of the base's family nearest to what is sampled: for reading, not what is sampled."""
        return self.base.with_parameters(state.parameters)

    @property
    def _iteration_size(self) -> int:
        return self.options.iteration_size(self.base.dim)

    # -- steps -----------------------------------------------------------------------------------------------

    def _rows(self, state: MixtureState) -> tuple[int, int]:
        if state.phase != "estimate":
            return 0, self._iteration_size
        return state.f.size, min(state.f.size + self.options.batch_size, state.look_at)

    def _standard(self, state: MixtureState) -> Array:
        """The batch in standard-normal space: drawn again rather than kept."""
        rows = self._rows(state)
        return draw_standard(
            state.mixtures[-1], self.base.dim, state.seed, state.phase, state.iteration, *rows
        )

    def _search_step(self, state: MixtureState, f: Array) -> tuple[MixtureState, TrainingRecord]:
        o = self.options
        u = self._standard(state)
        ok = np.flatnonzero(~np.isnan(f))
        quantile = order_statistic(f[ok], o.rho)
        level = min(state.level, quantile if quantile < math.inf else _largest_finite(f))
        level = max(self.gamma, level)
        new, old = ok[f[ok] <= level], state.elite_f <= level
        elite_u = np.concatenate([state.elite_u[old], u[new]])
        elite_f = np.concatenate([state.elite_f[old], f[new]])
        log_w = -_mean_log_ratio(state.mixtures, elite_u)
        weights = normalised(log_w)
        reached_at = state.iteration if state.reached_at < 0 and quantile <= self.gamma else state.reached_at
        improved = quantile < state.least_quantile
        improved_at = state.iteration if improved else state.improved_at
        mixtures, fits, parameters = state.mixtures, state.fits, state.parameters
        step = 0.0
        if elite_f.size >= 2:
            source = generator(state.seed, _FIT_KIND, "train", state.iteration, 0)
            part = fit(elite_u, weights, o.components, source)
            fits = (*fits, part)
            mixtures = (*mixtures, self._defended(fits))
            parameters = self._described(elite_u, weights, part)
            step = 1.0
        else:
            mixtures = (*mixtures, mixtures[-1])
        k = state.iteration + 1
        over = (
            k >= o.most_iterations(self.base.dim)
            or (reached_at >= 0 and k > reached_at + o.refinements)
            or (reached_at < 0 and k > improved_at + PATIENCE)
        )
        current = state.mixtures[-1]
        record = TrainingRecord(
            iteration=state.iteration,
            rollouts=f.size,
            gamma_k=level,
            quantile=quantile,
            elites=int(elite_f.size),
            ess=effective_sample_size(log_w),
            max_weight_share=max_share(log_w),
            events=int(np.count_nonzero(f <= self.gamma)),
            infinite=int(np.count_nonzero(f == math.inf)),
            failed=int(f.size - ok.size),
            step=step,
            kl=float(np.mean(log_ratio(current, u))),
            summary=_summary(current),
        )
        limit = o.budget - k * self._iteration_size
        after = msgspec.structs.replace(
            state,
            phase="estimate" if over else "train",
            iteration=0 if over else k,
            mixtures=mixtures,
            fits=fits[-2:],
            parameters=parameters,
            level=level,
            least_quantile=min(state.least_quantile, quantile)
            if quantile == quantile
            else state.least_quantile,
            reached_at=reached_at,
            improved_at=improved_at,
            elite_u=elite_u[:0] if over else elite_u,
            elite_f=elite_f,
            records=(*state.records, record),
            failed=state.failed + tuple((state.iteration, int(i)) for i in np.flatnonzero(np.isnan(f))),
            base_f=f if state.iteration == 0 else state.base_f,
            look_at=(limit if o.rel_error is None else min(o.batch_size, limit)) if over else 0,
        )
        return after, record

    def _defended(self, fits: tuple[Part, ...]) -> Mixture:
        """The fits so far with the base beside them."""
        o = self.options
        ladder = o.ladder_share if len(fits) > 1 else 0.0
        parts = [msgspec.structs.replace(fits[-1], weight=1.0 - o.base_share - ladder)]
        if ladder:
            parts.append(msgspec.structs.replace(fits[-2], weight=ladder))
        return Mixture(o.base_share, tuple(parts))

    def _described(self, u: Array, weights: Array, part: Part) -> Array:
        """Parameters of the base's family nearest to the elites: Betas fitted to them, means as the part has them."""
        base = self.base
        x = from_standard(base, u)
        log_u, log_v = base.betas.statistics(x[:, base.beta_columns])
        target = np.stack([weights @ log_u, weights @ log_v])
        own = np.stack([base.betas.alpha, base.betas.beta])
        betas = beta_update.update(own, target, np.minimum(own, 0.2), np.maximum(own, 50.0))
        shift = part.basis @ (part.shares @ part.means)
        means = [
            block.mean + block.factor @ shift[start : start + block.dim] for start, block in base.normals
        ]
        others = [marginal.shift + shift[column] for column, marginal in base.marginals]
        return np.concatenate([betas[0], betas[1], *means, others])

    def _estimation_step(self, state: MixtureState, f: Array) -> tuple[MixtureState, EstimationRecord]:
        o = self.options
        log_w = -log_ratio(state.mixtures[-1], self._standard(state))
        after = msgspec.structs.replace(
            state, f=np.concatenate([state.f, f]), log_weights=np.concatenate([state.log_weights, log_w])
        )
        est = self.estimate(after)
        if after.f.size >= state.look_at:
            limit = o.budget - sum(record.rollouts for record in state.records)
            look_at, done = next_look(est, after.f.size, limit, o.batch_size)
            after = msgspec.structs.replace(after, look_at=look_at, phase="done" if done else "estimate")
        return after, record_of(est)

    def _search_conditions(self, state: MixtureState) -> list[Condition]:
        found: list[Condition] = []
        if state.phase == "train" or not state.records:
            return found
        if state.reached_at < 0:
            found.append(
                Condition(
                    "threshold-not-reached",
                    f"the lowest {self.options.rho:g}-quantile of f in the search was "
                    f"{state.least_quantile:.4g}, above gamma = {self.gamma:g}: the proposal makes the event rarer "
                    "than rho",
                    "a larger budget, or method splitting",
                )
            )
        elites = math.ceil(self.options.rho * self._iteration_size)
        if elites < LEAST_ELITES:
            found.append(
                Condition(
                    "small-search",
                    f"the search fits {elites} elites an iteration (fewer than {LEAST_ELITES}): a part of the event "
                    "may have been missed without a sign",
                    "a larger budget or samples_per_iteration, or compare with method splitting",
                )
            )
        starved = [r.iteration for r in state.records if not r.quantile < math.inf]
        if starved:
            found.append(
                Condition(
                    "quantile-infinite",
                    f"in {len(starved)} iterations (first: {starved[0]}) fewer than rho N rollouts had a finite f: "
                    "the search went by the few finite ones",
                    "more samples an iteration, a larger rho, or a measure f that is finite more often",
                )
            )
        return found


def _largest_finite(f: Array) -> float:
    return float(np.max(f[np.isfinite(f)], initial=-math.inf)) if np.isfinite(f).any() else math.inf


def _mean_log_ratio(mixtures: tuple[Mixture, ...], u: Array) -> Array:
    """log of the mean over the iterations of q_t / phi, (n,)."""
    total = np.zeros(u.shape[0])
    for count, mixture in enumerate(mixtures):
        ratio = log_ratio(mixture, u)
        total = ratio if count == 0 else np.logaddexp(total, ratio)
    return total - math.log(len(mixtures))


def _summary(mixture: Mixture) -> dict[str, float]:
    """The sampled mixture in a few numbers."""
    if not mixture.parts:
        return {"components": 0.0, "directions": 0.0, "scale": 1.0, "shift_norm_max": 0.0}
    part = mixture.parts[0]
    return {
        "components": float(part.shares.size),
        "directions": float(part.basis.shape[1]),
        "scale": part.scale,
        "shift_norm_max": float(np.sqrt(np.sum(part.means**2, axis=1)).max()),
    }
