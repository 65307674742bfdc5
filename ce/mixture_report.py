"""What mixture sampling tells of its search: records, the proposal in the base's own terms, and warnings."""

import math

import numpy as np
from numpy.typing import NDArray

from ce import beta_update
from ce.gaussian_mixture import Mixture, Part
from ce.importance import starved_condition
from ce.product import Product
from ce.results import ENOUGH_EVENTS, Condition
from ce.standard import from_standard
from ce.state import MixtureState, TrainingRecord
from ce.weights import effective_sample_size

Array = NDArray[np.float64]

LEAST_ELITES = 100
LEAST_WORTH = 50  # of the last elites, in effective events
LEAST_COVERAGE = 0.95  # of the look's states, below which a warning says so


def record_of_search(
    gamma: float,
    state: MixtureState,
    f: Array,
    level: float,
    quantile: float,
    kl: float,
    summary: dict[str, float],
) -> TrainingRecord:
    return TrainingRecord(
        iteration=state.iteration,
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


def described(base: Product, u: Array, weights: Array, part: Part) -> Array:
    """Parameters of the base's family nearest to the elites: Betas fitted to them, means as the part has them."""
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


def search_conditions(state: MixtureState, gamma: float, rho: float, iteration_size: int) -> list[Condition]:
    found: list[Condition] = []
    if state.phase in ("train", "look") or not state.records:
        return found
    if state.reached_at < 0 and effective_sample_size(state.log_weights[state.f <= gamma]) < ENOUGH_EVENTS:
        found.append(
            Condition(
                "threshold-not-reached",
                f"the lowest {rho:g}-quantile of f in the search was "
                f"{state.least_quantile:.4g}, above gamma = {gamma:g}: the proposal makes the event rarer "
                "than rho",
                "give a larger budget, or use method splitting",
            )
        )
    if state.coverage < LEAST_COVERAGE:
        found.append(
            Condition(
                "modes-not-covered",
                f"a look apart from the search met parts of the event, {1.0 - state.coverage:.0%} of what it saw, "
                "that the proposal hardly samples: p may be too low by what they carry",
                "give a larger budget, and compare with method splitting",
            )
        )
    elites = math.ceil(rho * iteration_size)
    worth = [r.ess for r in state.records if "look" not in r.summary][-1]
    if elites < LEAST_ELITES or worth < LEAST_WORTH:
        found.append(
            Condition(
                "small-search",
                f"the search fits {elites} elites an iteration, at the end worth {worth:.0f} of equal weight "
                f"({LEAST_ELITES} and {LEAST_WORTH} needed): a part of the event may have been missed without a sign",
                "give a larger budget (or samples_per_iteration), or compare with method splitting",
            )
        )
    starved = starved_condition(state.records)
    return [*found, starved] if starved else found
