"""The frozen states of the algorithms, which `ce.codec` writes as bytes."""

import math

import msgspec
import numpy as np
from numpy.typing import NDArray

from ce.chains import Chains
from ce.codec import FORMAT
from ce.gaussian_mixture import Mixture, Part
from ce.mode_search import ModeSearch
from ce.records import TrainingRecord

Array = NDArray[np.float64]


class FreshSample(msgspec.Struct, frozen=True, eq=False):
    """The estimation rollouts, and when to stop (`ce.stopping`).

    f: (n,), values so far, NaN = failed
    log_weights: (n,), log p0 / q of each
    interim_at: number of rollouts at the next interim look
    trial: rollouts at the beginning that only plan the others
    interim_looks: interim looks made at the rollouts that count
    """

    f: Array
    log_weights: Array
    interim_at: int
    trial: int = 0
    interim_looks: int = 0


NOTHING = np.zeros(0)
NO_SAMPLE = FreshSample(NOTHING, NOTHING, 0)


class NaiveState(msgspec.Struct, frozen=True, eq=False):
    """Naive Monte Carlo.

    digest: of the problem and the options
    seed: of the stream
    f: (n,), values so far, NaN = failed
    interim_at: number of rollouts at the next interim look
    done: whether the run is over
    trial: rollouts at the beginning that only plan the others (`ce.stopping`)
    interim_looks: interim looks made at the rollouts that count
    """

    digest: str
    seed: int
    f: Array
    interim_at: int
    done: bool
    trial: int = 0
    interim_looks: int = 0
    method: str = "naive"
    format: int = FORMAT


class SearchedState(msgspec.Struct, frozen=True, eq=False, kw_only=True):
    """What the states of `ce.importance` share: a search, then a fresh sample.

    digest: of the problem and the options
    seed: of the streams
    phase: "train", "estimate" or "done", and what else the search has
    iteration: batches of the search answered; 0 in the estimate
    parameters: (s,), of the proposal being sampled, or of the member of the base's family nearest to it
    records: one a batch of the search
    failed: (iteration, row) of each failed rollout of the search
    base_f: (N_0,), f of the first iteration, whose rollouts come from the base itself
    sample: the estimation rollouts
    """

    digest: str
    seed: int
    phase: str = "train"
    iteration: int = 0
    parameters: Array
    records: tuple[TrainingRecord, ...] = ()
    failed: tuple[tuple[int, int], ...] = ()
    base_f: Array = NOTHING
    sample: FreshSample = NO_SAMPLE


class CrossEntropyState(SearchedState, frozen=True, eq=False, kw_only=True):
    """Algorithm 1.

    best_parameters: (s,), of the proposal with the lowest rho-quantile
    best_quantile: that quantile, in the unit of f
    """

    best_parameters: Array
    best_quantile: float = math.inf
    method: str = "ce"
    format: int = FORMAT


class MixtureSearch(msgspec.Struct, frozen=True, eq=False):
    """How far the search of mixture sampling has come.

    level: lowest level so far whose elites suffice for a fit, in the unit of f
    least_quantile: lowest rho-quantile of a batch so far, in the unit of f
    reached_at: number of the fit whose level was first gamma, -1 for none
    improved_at: number of the fit that had the lowest quantile
    elite_u: (e, d), elites in standard-normal space
    elite_f: (e,), their values
    fits: the last two fits to elites
    found: fit to events of the mode search that no proposal covered, None for none
    mode_search: the search for modes that the proposals miss, None before it and in the estimate
    ess_rates: effective events a rollout of each batch since the threshold was reached
    log_efficiencies: of the proposal of each batch, at the level it was fitted to (`ce.log_efficiency`)
    shares: p by each batch alone
    """

    level: float
    least_quantile: float
    reached_at: int
    improved_at: int
    elite_u: Array
    elite_f: Array
    fits: tuple[Part, ...] = ()
    found: Part | None = None
    mode_search: ModeSearch | None = None
    ess_rates: tuple[float, ...] = ()
    log_efficiencies: tuple[float, ...] = ()
    shares: tuple[float, ...] = ()


class MixtureState(SearchedState, frozen=True, eq=False, kw_only=True):
    """Mixture sampling, which has the phase "mode-search", too.

    mixtures: the proposals so far, the last of them the one being sampled
    search: how far the search has come
    mode_coverage: share of the mode search's states that the last proposal covers, NaN without a mode search
    """

    mixtures: tuple[Mixture, ...]
    search: MixtureSearch
    mode_coverage: float = math.nan
    method: str = "mixture"
    format: int = FORMAT


class LevelState(msgspec.Struct, frozen=True, eq=False):
    """The level that splitting is sampling.

    number: of the level, 0 for the base
    chain_length: states of each chain so far, its seed included; 0 before the level's first batch
    chains: their present states, from which the next batch moves
    sample: the level's sample so far; in the replications only the rows that the next level may grow from
    """

    number: int
    chain_length: int
    chains: Chains
    sample: Chains


class PilotState(msgspec.Struct, frozen=True, eq=False):
    """The adaptive run of splitting, which fixes levels and step sizes for the replications.

    size: samples of a level
    rollouts: that the pilot has taken
    levels: (L,), thresholds so far, falling, in the unit of f; the last one gamma once the pilot is over
    steps: (L - 1, d), step sizes of the moves below each level but the last, in (0, 1]
    step_factor: that the step sizes of the present level are multiplied by, adapted to the acceptance
    base_f: (size,), f of level 0, whose rollouts come from the base itself
    reached: whether a level of probability p0 has come down to gamma
    """

    size: int
    rollouts: int
    levels: Array
    steps: Array
    step_factor: float
    base_f: Array
    reached: bool


class ReplicationsState(msgspec.Struct, frozen=True, eq=False):
    """The independent runs of splitting with fixed levels and steps, some of them at a time.

    size: samples of a level in one replication
    count: replications in all
    group_size: replications that are run side by side
    group: number of the present group
    log_p: (group_size,), log P(f <= present level) by each replication of the group
    f: (n,), values of what the levels so far leave behind
    log_weights: (n,), their log weights; the weights of a replication sum to one
    replication: (n,) int64, the number of each one's replication
    """

    size: int
    count: int
    group_size: int
    group: int
    log_p: Array
    f: Array
    log_weights: Array
    replication: NDArray[np.int64]


class SplittingState(msgspec.Struct, frozen=True, eq=False):
    """Splitting.

    digest: of the problem and the options
    seed: of the streams
    phase: "pilot", "replications" or "done"
    batches: answered so far
    rollouts: answered so far, the pilot's included
    level: the level being sampled, in the pilot or in a group of replications
    pilot: the adaptive run, and the levels and steps that it has fixed
    replications: the runs that the estimate is made of; empty during the pilot
    failed: (batch, row) of each failed rollout
    """

    digest: str
    seed: int
    phase: str
    batches: int
    rollouts: int
    level: LevelState
    pilot: PilotState
    replications: ReplicationsState
    failed: tuple[tuple[int, int], ...]
    method: str = "splitting"
    format: int = FORMAT


class AutoState(msgspec.Struct, frozen=True):
    """Method auto.

    digest: of the problem and the options
    seed: of the run, from which each stage has its own
    stage: "mixture", "naive" or "splitting"
    spent: rollouts of earlier stages
    tried: whether the trial of the proposal is over
    inner: the stage's own state as bytes
    failed: (phase, iteration, row) of each failed rollout of earlier stages
    reason: why another stage was left for this one, empty for none
    """

    digest: str
    seed: int
    stage: str
    spent: int
    tried: bool
    inner: bytes
    failed: tuple[tuple[str, int, int], ...]
    reason: str
    method: str = "auto"
    format: int = FORMAT
