"""The steps of mixture sampling's search: elites of all batches so far, how far they bring it, the fit to them."""

import math
from dataclasses import dataclass

import msgspec
import numpy as np
from numpy.typing import NDArray

from ce import mode_search
from ce.gaussian_mixture import Mixture, Part, component_of, log_ratio, mean_log_ratio
from ce.log_efficiency import log_efficiency
from ce.mixture_fit import aligned
from ce.mixture_options import HIGH_DIMENSION, MOST_ELITES, MixtureOptions
from ce.mixture_report import LEAST_ELITES
from ce.regression import Direction, downhill
from ce.state import MixtureSearch, MixtureState
from ce.streams import generator
from ce.subspace import LARGEST_FREE
from ce.weights import effective_sample_size, normalised

Array = NDArray[np.float64]

FIT_KIND = 0x66697400
# Effective events from which the search jumps to gamma itself.
ENOUGH_TO_JUMP = 40.0
# Effective elites that suffice, however large an iteration is.
ENOUGH_ELITES = 200.0
MOST_DIRECTIONS = 8
# Share in the proposal of what the mode search has found: just after it, and in those that follow.
FOUND_FIRST, FOUND_SHARE = 0.4, 0.1
# Share of the event below which it does not matter whether a part of it is covered.
LEAST_MASS = 0.01


@dataclass(frozen=True)
class Elites:
    """What the next proposal is fitted to.

    level: they have f <= level
    u: (e, d), points in standard-normal space
    f: (e,), their values
    log_weights: (e,), of the balance heuristic over all proposals so far
    older: number of them, the first ones, that come from earlier batches
    rows: (e - older,), of the present batch, that the others are
    """

    level: float
    u: Array
    f: Array
    log_weights: Array
    older: int
    rows: NDArray[np.intp]


def initial_search(dim: int) -> MixtureSearch:
    """The search before its first batch."""
    return MixtureSearch(
        level=math.inf,
        least_quantile=math.inf,
        reached_at=-1,
        improved_at=0,
        elite_u=np.zeros((0, dim)),
        elite_f=np.zeros(0),
    )


def chosen_elites(
    state: MixtureState, u: Array, f: Array, quantile: float, gamma: float, options: MixtureOptions
) -> Elites:
    """The elites among those so far and a batch, at most MOST_ELITES of them.

    state: before the batch
    u: (n, d), the batch in standard-normal space
    f: (n,), its values, NaN = failed rollout
    quantile: its rho-quantile, in the unit of f
    gamma: threshold of the event, in the unit of f
    options: of the method
    """
    search = state.search
    ok = np.flatnonzero(~np.isnan(f))
    # All that may be an elite, from which the lowest level is chosen that enough of them, by weight, are below.
    top = search.level
    if not top < math.inf:
        top = quantile if quantile < math.inf else _largest_finite(f)
    top = max(top, gamma)
    new = ok[f[ok] <= top]
    older = search.elite_f.size
    pool_f = np.concatenate([search.elite_f, f[new]])
    pool_u = np.concatenate([search.elite_u, u[new]])
    log_w = -mean_log_ratio(state.mixtures, pool_u)
    level = lowest_level(pool_f, log_w, top, gamma, u.shape[1], options)
    kept = np.flatnonzero(pool_f <= level)
    if kept.size > MOST_ELITES:
        source = generator(state.seed, FIT_KIND, "train", state.iteration, 2)
        kept = np.sort(source.permutation(kept)[:MOST_ELITES])
    return Elites(
        level=level,
        u=pool_u[kept],
        f=pool_f[kept],
        log_weights=log_w[kept],
        older=int(np.count_nonzero(kept < older)),
        rows=new[kept[kept >= older] - older],
    )


def lowest_level(
    f: Array, log_w: Array, top: float, gamma: float, dim: int, options: MixtureOptions
) -> float:
    """The lowest level, from gamma to `top`, below which the effective number of values is enough for a fit.

    In few dimensions it is gamma itself already where there are ENOUGH_TO_JUMP effective events.

    f: (n,), values
    log_w: (n,), their log weights
    top: the level at most, in the unit of f
    gamma: threshold of the event, in the unit of f
    dim: d
    options: of the method
    """
    all_elites = options.rho * options.iteration_size(dim)
    needed = min(all_elites, max(LEAST_ELITES, min(0.6 * all_elites, ENOUGH_ELITES)))
    jump = min(needed, ENOUGH_TO_JUMP) if dim <= HIGH_DIMENSION else needed
    if effective_sample_size(log_w[f <= gamma]) >= jump:
        return gamma
    order = np.argsort(f)
    w = np.exp(log_w[order] - np.max(log_w, initial=-math.inf))
    with np.errstate(invalid="ignore"):
        ess = np.cumsum(w) ** 2 / np.cumsum(w * w)
    enough = np.flatnonzero(ess >= needed * (1.0 - 1e-9))
    if enough.size == 0 or (first := f[order[enough[0]]]) > top:
        return top
    return max(float(first), gamma)


def progressed(
    search: MixtureSearch,
    elites: Elites,
    f: Array,
    ratio: Array,
    quantile: float,
    fits_made: int,
    gamma: float,
) -> MixtureSearch:
    """The search with a batch taken into account.

    search: before the batch
    elites: after it
    f: (n,), its values
    ratio: (n,), log q / phi of each row, q being its proposal
    quantile: its rho-quantile, in the unit of f
    fits_made: proposals so far
    gamma: threshold of the event, in the unit of f
    """
    event_log_w = -ratio[f <= gamma]
    reached = search.reached_at >= 0 or elites.level <= gamma
    ess_rates = search.ess_rates
    if reached:
        ess_rates = (*ess_rates, effective_sample_size(event_log_w) / f.size)
    improved = quantile < search.least_quantile
    return msgspec.structs.replace(
        search,
        level=elites.level,
        least_quantile=quantile if improved else search.least_quantile,
        reached_at=fits_made if reached and search.reached_at < 0 else search.reached_at,
        improved_at=fits_made if improved else search.improved_at,
        elite_u=elites.u,
        elite_f=elites.f,
        ess_rates=ess_rates,
        log_efficiencies=(*search.log_efficiencies, log_efficiency(f, -ratio, search.level)),
        shares=(*search.shares, float(np.exp(event_log_w).sum()) / f.size),
    )


def proposal_of(search: MixtureSearch, log_w: Array, first: bool, options: MixtureOptions) -> Mixture:
    """The proposal made of the last fits, what the mode search found, and the base.

    log_w: log weights of the elites
    first: whether the mode search has found it just now, in few enough dimensions that its rows will tell where f
        falls, or it was aligned with that just now
    """
    poor = effective_sample_size(log_w) < LEAST_ELITES
    parts = []
    if len(search.fits) > 1 and options.ladder_share:
        parts.append(msgspec.structs.replace(search.fits[-2], weight=options.ladder_share))
    if search.found is not None:
        weight = FOUND_FIRST if first or poor else FOUND_SHARE
        parts.append(msgspec.structs.replace(search.found, weight=weight))
    rest = 1.0 - options.base_share - sum(part.weight for part in parts)
    return Mixture(options.base_share, (msgspec.structs.replace(search.fits[-1], weight=rest), *parts))


def directions_of(mixture: Mixture, u: Array, f: Array, elites: Elites) -> list[Direction]:
    """Where f falls over a batch, and around each component of its proposal that has rows enough; surest first.

    mixture: the proposal that the batch was drawn from
    u: (n, d), the batch in standard-normal space
    f: (n,), its values
    elites: whose influence on the directions is wanted
    """
    if u.shape[1] <= LARGEST_FREE:
        return []
    label = component_of(mixture, u)
    groups = [np.arange(u.shape[0])]
    groups += [np.flatnonzero(label == j) for j in range(label.max() + 1)] if label.max() > 0 else []
    found = []
    for rows in groups:
        direction = downhill(u[rows], f[rows], np.flatnonzero(np.isin(rows, elites.rows)))
        if direction is None:
            continue
        influence = np.zeros(u.shape[0])
        influence[rows] = direction.influence
        influence = np.concatenate([np.zeros(elites.older), influence[elites.rows]])
        found.append(Direction(direction.vector, influence, direction.cosine2))
    return sorted(found, key=lambda direction: -direction.cosine2)[:MOST_DIRECTIONS]


def aligned_found(found: Part, sampled: Mixture, u: Array, f: Array) -> Part:
    """What the mode search found, its means brought to where the first batch drawn from it says that f falls."""
    label = component_of(sampled, u) - (1 + sum(part.shares.size for part in sampled.parts[:-1]))
    return aligned(found, np.maximum(label, -1), u, f)


def mode_coverage(state: MixtureState) -> float:
    """Share of the mode search's states that the last fits cover, what it found left out; NaN without a mode search.

    It is 1 where the elites that the fits do not cover carry less than LEAST_MASS of the event.
    """
    search = state.search
    if search.mode_search is None or not search.mode_search.visited.size:
        return math.nan
    last = state.mixtures[-1]
    if search.found is not None:
        last = Mixture(last.base_share, last.parts[:-1])
    elite_log_w = -mean_log_ratio(state.mixtures[:-1], search.elite_u)
    missed = mode_search.uncovered(-log_ratio(last, search.elite_u), elite_log_w)
    if float(normalised(elite_log_w)[missed].sum()) < LEAST_MASS:
        return 1.0
    visited_log_w = -log_ratio(last, search.mode_search.visited)
    return 1.0 - float(np.mean(mode_search.uncovered(visited_log_w, elite_log_w)))


def _largest_finite(f: Array) -> float:
    return float(np.max(f[np.isfinite(f)], initial=-math.inf)) if np.isfinite(f).any() else math.inf
