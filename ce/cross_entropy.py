"""Algorithm 1 of the paper, the cross-entropy method, behind the ask-and-tell interface.

    for k = 0 .. K - 1:
        X_1 .. X_N ~ P_theta_k                                     propose
        gamma_k = max(gamma, rho-quantile of f(X))                 update: _search_step
        w_i = p0(X_i) / p_theta_k(X_i) on {f <= gamma_k}, divided by their sum
        theta_{k+1} = argmax over Theta of alpha theta^T sum w_i Gamma(X_i) + (1 - alpha) theta^T grad
        A(theta_k) - A(theta)
    theta_ce = the theta_k with the lowest rho-quantile
    X_1 .. X_n ~ P_theta_ce, fresh;  p = (1/n) sum p0/p_theta_ce(X_i) 1{f(X_i) <= gamma}

Deviations, all deliberate: line 5 of the paper prints "minimum" where its text has gamma_k >= gamma, hence
the maximum; the weights of equation (3) are normalised over the elite set, because q_k is a density; the
quantile is an order statistic among the rollouts that did not fail. Where fewer than rho N values of f are
finite the quantile is +inf and says nothing: the elite set is then all finite values, and the step is
shortened in proportion to how many there are.
"""

import functools
import math
from dataclasses import dataclass, replace

import msgspec
import numpy as np
from numpy.typing import ArrayLike, NDArray

from ce.checks import (
    at_least,
    budget_is_an_integer,
    checked_response,
    checked_turn,
    in_range,
    precision_in_range,
)
from ce.errors import BudgetError, OptionsError
from ce.estimate_warnings import EstimateWarning
from ce.importance import ImportanceSampling, failed_rows, starved_warning
from ce.product import Product
from ce.projection import Projection
from ce.records import Batch, EstimationRecord, TrainingRecord
from ce.state import CrossEntropyState
from ce.stopping import first_interim
from ce.streams import draw
from ce.weights import effective_sample_size, max_share, normalised, order_statistic

Array = NDArray[np.float64]

LEAST_BUDGET = 1000
_BISECTIONS = 12


@dataclass(frozen=True)
class CrossEntropyOptions:
    """Options of Algorithm 1, whose constraints are by default the paper's (section 4).

    iterations: K (None: filled from budget, see `sizes`)
    samples_per_iteration: N_k; a search iteration is always one batch (None: filled from budget)
    rho: quantile level, in (0, 1)
    step: alpha, in (0, 1]
    estimation_rollouts: fresh rollouts at most (None: filled from budget)
    budget: rollouts in all, into which the other sizes must fit (None: no limit of its own)
    beta_bounds: of alpha and beta of every Beta
    mean_box: largest |mu - mu0| of every Normal, in its own units (None: no bound)
    learn_covariance: move the Normals' covariances too; for low dimensions, needs mean_box = None
    max_kl: largest KL(P_theta || P0), nats, by shortening the step (None: no limit)
    stop_when_reached: leave the search as soon as gamma_k = gamma (False: all K iterations, as printed)
    rel_error: relative half-width of the interval to stop at (None: use all estimation_rollouts)
    confidence: of the interval, in (0, 1)
    batch_size: estimation rollouts in a batch
    """

    iterations: int | None = None
    samples_per_iteration: int | None = None
    rho: float = 0.01
    step: float = 0.8
    estimation_rollouts: int | None = None
    budget: int | None = None
    beta_bounds: tuple[float, float] = (1.5, 7.0)
    mean_box: float | None = 0.01
    learn_covariance: bool = False
    max_kl: float | None = None
    stop_when_reached: bool = False
    rel_error: float | None = None
    confidence: float = 0.95
    batch_size: int = 5000

    def __post_init__(self) -> None:
        for name, least in (("iterations", 1), ("samples_per_iteration", 10), ("estimation_rollouts", 1)):
            if getattr(self, name) is not None:
                at_least(name, getattr(self, name), least)
        at_least("batch_size", self.batch_size, 1)
        in_range("rho", self.rho, 0, 1)
        precision_in_range(self.rel_error, self.confidence)
        if self.step != 1:
            in_range("step", self.step, 0, 1)
        if self.max_kl is not None:
            in_range("max_kl", self.max_kl, 0, math.inf)
        if self.mean_box is not None:
            in_range("mean_box", self.mean_box, 0, math.inf)
        try:
            low, high = (float(b) for b in self.beta_bounds)
        except (TypeError, ValueError):
            raise OptionsError(f"beta_bounds must be two numbers, not {self.beta_bounds!r}") from None
        if not 0 < low <= high < math.inf:
            raise OptionsError(f"beta_bounds must satisfy 0 < low <= high < inf, not ({low}, {high})")
        object.__setattr__(self, "beta_bounds", (low, high))
        if self.learn_covariance and self.mean_box is not None:
            raise OptionsError(
                "learn_covariance needs mean_box=None: a boxed mean and a free covariance do not separate"
            )
        if self.budget is not None:
            budget_is_an_integer(self.budget)
            if self.budget < LEAST_BUDGET:
                raise BudgetError(
                    f"the cross-entropy method needs a budget of at least {LEAST_BUDGET}, not {self.budget}"
                )

    def sizes(self) -> tuple[int, int, int]:
        """K, N_k and n, with every None filled in; BudgetError where they do not fit.

        From a budget (100,000 if none is given): K = 10 (5 below 10,000), N_k such that the search takes two
        fifths, and the rest for the estimate.
        """
        budget = 100_000 if self.budget is None else self.budget
        iterations = self.iterations or (10 if budget >= 10_000 else 5)
        if self.estimation_rollouts is None:
            per_iteration = self.samples_per_iteration or max(10, int(0.4 * budget) // iterations)
            estimation = budget - iterations * per_iteration
        else:
            estimation = self.estimation_rollouts
            per_iteration = self.samples_per_iteration or (budget - estimation) // iterations
        total = iterations * per_iteration + estimation
        if estimation < 1 or per_iteration < 10 or (self.budget is not None and total > self.budget):
            raise BudgetError(
                f"{iterations} iterations of {per_iteration} rollouts and {estimation} for the estimate do not "
                f"fit into a budget of {budget}: raise the budget, or lower iterations, "
                "samples_per_iteration or estimation_rollouts"
            )
        return iterations, per_iteration, estimation

    def held_rows(self, dim: int) -> int:
        """Rows of `dim` numbers that a state and its open batch hold together at most."""
        _, per_iteration, estimation = self.sizes()
        return max(per_iteration, min(self.batch_size, estimation))

    def resolved(self) -> "CrossEntropyOptions":
        """The same with the sizes filled in."""
        iterations, per_iteration, estimation = self.sizes()
        return replace(
            self, iterations=iterations, samples_per_iteration=per_iteration, estimation_rollouts=estimation
        )


@dataclass(frozen=True)
class CrossEntropy(ImportanceSampling[CrossEntropyState], method="ce", state_type=CrossEntropyState):
    """Algorithm 1 as pure functions of a frozen `CrossEntropyState`."""

    options: CrossEntropyOptions = CrossEntropyOptions()

    def __post_init__(self) -> None:
        super().__post_init__()
        object.__setattr__(self, "options", self.options.resolved())

    @functools.cached_property
    def projection(self) -> Projection:
        """The constrained family around the base."""
        o = self.options
        return Projection(self.base, o.beta_bounds, o.mean_box, o.learn_covariance)

    @property
    def total_rollouts(self) -> int:
        """Rollouts at most, training included."""
        iterations, per_iteration, estimation = self.options.sizes()
        return iterations * per_iteration + estimation

    # -- ask and tell ----------------------------------------------------------------------------------------

    def _initial(self, seed: int) -> CrossEntropyState:
        theta = self.base.parameters(self.options.learn_covariance)
        return CrossEntropyState(
            digest=self.digest,
            seed=seed,
            parameters=theta,
            best_parameters=theta,
        )

    def propose(self, state: CrossEntropyState) -> Batch | None:
        """The next batch, one iteration of the search or a part of the fresh sample; None when finished."""
        if state.phase == "done":
            return None
        start, stop = self._rows(state)
        x, noise = draw(self.proposal(state), state.seed, state.phase, state.iteration, start, stop)
        return Batch(state.phase, state.iteration, x, noise, state.parameters, state.seed, start, stop)

    def update(
        self, state: CrossEntropyState, batch: Batch, f: ArrayLike
    ) -> tuple[CrossEntropyState, TrainingRecord | EstimationRecord]:
        """The state after the batch was answered with f (n,), NaN = failed rollout, and what happened."""
        checked_turn(batch, state.seed, state.phase, state.iteration, self._rows(state)[0])
        values = checked_response(batch, f)
        if state.phase == "train":
            return self._search_step(state, batch, values)
        log_w = self.base.log_ratio(self.proposal(state), batch.x)
        return self._estimation_step(state, values, log_w)

    def proposal(self, state: CrossEntropyState) -> Product:
        """The distribution being sampled now."""
        return self._with(state.parameters)

    # -- steps -----------------------------------------------------------------------------------------------

    def _with(self, parameters: Array) -> Product:
        return self.base.with_parameters(parameters)

    def _rows(self, state: CrossEntropyState) -> tuple[int, int]:
        if state.phase != "estimate":
            return 0, self.options.sizes()[1]
        answered = state.sample.f.size
        return answered, min(answered + self.options.batch_size, state.sample.interim_at)

    def _search_step(
        self, state: CrossEntropyState, batch: Batch, f: Array
    ) -> tuple[CrossEntropyState, TrainingRecord]:
        o, current = self.options, self.proposal(state)
        ok = np.flatnonzero(~np.isnan(f))
        quantile = order_statistic(f[ok], o.rho)
        finite = f[ok][f[ok] < math.inf]
        step = o.step
        if quantile < math.inf:
            gamma_k = max(self.gamma, quantile)
        else:  # also NaN: every rollout failed
            gamma_k = max(self.gamma, float(np.max(finite, initial=-math.inf)))
            step *= min(1.0, finite.size / math.ceil(o.rho * f.size))
        elite = ok[f[ok] <= gamma_k]
        log_w = self.base.log_ratio(current, batch.x[elite])
        if elite.size:
            theta, step = self._projected(current, batch.x[elite], normalised(log_w), step)
        else:
            theta, step = state.parameters, 0.0
        record = TrainingRecord(
            iteration=state.iteration,
            rollouts=f.size,
            gamma_k=gamma_k,
            quantile=quantile,
            elites=int(elite.size),
            ess=effective_sample_size(log_w),
            max_weight_share=max_share(log_w),
            events=int(np.count_nonzero(f <= self.gamma)),
            infinite=int(np.count_nonzero(f == math.inf)),
            failed=int(f.size - ok.size),
            step=step,
            kl=current.kl(self.base),
            summary=_summary(current, self.base),
        )
        best, best_quantile = state.best_parameters, state.best_quantile
        if quantile < best_quantile:
            best, best_quantile = state.parameters, quantile
        k = state.iteration + 1
        iterations, _, estimation = o.sizes()
        over = k == iterations or (o.stop_when_reached and quantile <= self.gamma)
        interim_at = first_interim(o.rel_error, estimation, o.batch_size) if over else 0
        after = msgspec.structs.replace(
            state,
            phase="estimate" if over else "train",
            iteration=0 if over else k,
            parameters=best if over else theta,
            best_parameters=best,
            best_quantile=best_quantile,
            records=(*state.records, record),
            failed=state.failed + failed_rows(state.iteration, f),
            base_f=f if state.iteration == 0 else state.base_f,
            sample=msgspec.structs.replace(state.sample, interim_at=interim_at),
        )
        return after, record

    def _projected(self, current: Product, x: Array, weights: Array, step: float) -> tuple[Array, float]:
        """The updated parameters and the step taken: shortened, by bisection, where max_kl would be exceeded."""
        theta = self.projection.update(current, x, weights, step)
        limit = self.options.max_kl
        if limit is None or self._with(theta).kl(self.base) <= limit:
            return theta, step
        theta, low, high = current.parameters(self.options.learn_covariance), 0.0, step
        for _ in range(_BISECTIONS):
            middle = 0.5 * (low + high)
            trial = self.projection.update(current, x, weights, middle)
            if self._with(trial).kl(self.base) <= limit:
                theta, low = trial, middle
            else:
                high = middle
        return theta, low

    def _estimation_limit(self, state: CrossEntropyState) -> int:
        return self.options.sizes()[2]

    def _sampled(self, state: CrossEntropyState) -> Product:
        return self._with(state.best_parameters)

    def _search_warnings(self, state: CrossEntropyState) -> list[EstimateWarning]:
        found: list[EstimateWarning] = []
        if state.phase == "train" or not state.records:
            return found
        if not state.best_quantile <= self.gamma:
            found.append(
                EstimateWarning(
                    "threshold-not-reached",
                    f"the lowest {self.options.rho:g}-quantile of f in the search was "
                    f"{state.best_quantile:.4g}, above "
                    f"gamma = {self.gamma:g}: the proposal makes the event rarer than rho",
                    "more iterations, more samples an iteration, or wider constraints",
                )
            )
        starved = starved_warning(state.records)
        return [*found, starved] if starved else found


def _summary(proposal: Product, base: Product) -> dict[str, float]:
    """The sampled proposal's parameters in a few numbers."""
    out: dict[str, float] = {}
    if base.beta_columns.size:
        out["alpha_min"], out["alpha_max"] = (
            float(proposal.betas.alpha.min()),
            float(proposal.betas.alpha.max()),
        )
        out["beta_min"], out["beta_max"] = float(proposal.betas.beta.min()), float(proposal.betas.beta.max())
    for i, ((_, block), (_, origin)) in enumerate(zip(proposal.normals, base.normals, strict=True)):
        shift = block.mean - origin.mean
        out[f"mean_shift_max_{i}"] = float(np.abs(shift).max())
        out[f"mean_shift_norm_{i}"] = float(np.sqrt(np.sum(shift**2)))
    return out
