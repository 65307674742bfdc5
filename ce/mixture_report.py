"""What mixture sampling tells of its search: records, the proposal in the base's own terms, and warnings."""

import math

import numpy as np
from numpy.typing import NDArray

from ce import beta_update
from ce.estimate_warnings import ENOUGH_EVENTS, EstimateWarning
from ce.gaussian_mixture import Mixture, Part
from ce.importance import of_fits, starved_warning
from ce.product import Product
from ce.records import TrainingRecord
from ce.standard import from_standard
from ce.state import MixtureState
from ce.weights import effective_sample_size

Array = NDArray[np.float64]

LEAST_ELITES = 100
# Effective number of the last elites, at least.
LEAST_ESS = 50
# Of the mode search's states, below which a warning says so.
LEAST_COVERAGE = 0.95


def record_of_search(
    gamma: float,
    iteration: int,
    f: Array,
    level: float,
    quantile: float,
    kl: float,
    summary: dict[str, float],
) -> TrainingRecord:
    """The record of a batch with values f (n,), whose gamma_k is `level` and whose elites are not weighed yet."""
    return TrainingRecord(
        iteration=iteration,
        rollouts=f.size,
        gamma_k=level,
        quantile=quantile,
        elites=int(np.count_nonzero(f <= level)),
        ess=0.0,
        max_weight_share=0.0,
        events=int(np.count_nonzero(f <= gamma)),
        infinite=int(np.count_nonzero(f == math.inf)),
        failed=int(np.count_nonzero(np.isnan(f))),
        step=0.0,
        kl=kl,
        summary=summary,
    )


def nearest_parameters(base: Product, u: Array, weights: Array, part: Part) -> Array:
    """Parameters (s,) of the member of the base's family nearest to what is sampled.

    base: distribution P0
    u: (e, d), elites, to which Betas are fitted
    weights: (e,), theirs, which sum to one
    part: that means and shifts are taken from
    """
    own = np.stack([base.betas.alpha, base.betas.beta])
    betas = own
    if base.beta_columns.size:
        log_u, log_v = base.betas.statistics(from_standard(base, u)[:, base.beta_columns])
        target = np.stack([weights @ log_u, weights @ log_v])
        betas = beta_update.update(own, target, np.minimum(own, 0.2), np.maximum(own, 50.0))
    shift = part.basis @ (part.shares @ part.means)
    means = [
        block.mean + block.coloured(shift[None, start : start + block.dim])[0]
        for start, block in base.normals
    ]
    others = [marginal.shift + shift[column] for column, marginal in base.marginals]
    return np.concatenate([betas[0], betas[1], *means, others])


def summary_of(mixture: Mixture) -> dict[str, float]:
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


def search_warnings(
    state: MixtureState, gamma: float, rho: float, iteration_size: int
) -> list[EstimateWarning]:
    """What is to be said of a search that is over."""
    found: list[EstimateWarning] = []
    if state.phase in ("train", "mode-search") or not state.records:
        return found
    events = state.sample.log_weights[state.sample.f <= gamma]
    if state.search.reached_at < 0 and effective_sample_size(events) < ENOUGH_EVENTS:
        found.append(
            EstimateWarning(
                "threshold-not-reached",
                f"the lowest {rho:g}-quantile of f in the search was "
                f"{state.search.least_quantile:.4g}, above gamma = {gamma:g}: the proposal makes the event rarer "
                "than rho",
                "give a larger budget, or use method splitting",
            )
        )
    if state.mode_coverage < LEAST_COVERAGE:
        found.append(
            EstimateWarning(
                "modes-not-covered",
                f"the mode search met parts of the event, {1.0 - state.mode_coverage:.0%} of what it saw, "
                "that the proposal hardly samples: p may be too low by what they carry",
                "give a larger budget, and compare with method splitting",
            )
        )
    elites = math.ceil(rho * iteration_size)
    ess = of_fits(state.records)[-1].ess
    if elites < LEAST_ELITES or ess < LEAST_ESS:
        found.append(
            EstimateWarning(
                "small-search",
                f"the search fits {elites} elites an iteration, at the end worth {ess:.0f} of equal weight "
                f"({LEAST_ELITES} and {LEAST_ESS} needed): a part of the event may have been missed without a sign",
                "give a larger budget (or samples_per_iteration), or compare with method splitting",
            )
        )
    starved = starved_warning(state.records)
    return [*found, starved] if starved else found
