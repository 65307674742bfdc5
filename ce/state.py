"""The frozen states of the algorithms, the batches they propose, and the states' bytes.

Bytes are MessagePack (msgspec); an array is a map of dtype, shape and its raw little-endian bytes, so that
a state read back is the same to the bit.
"""

import hashlib
from dataclasses import fields
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from ce.beta import Beta
from ce.errors import StateError
from ce.gaussian_mixture import Mixture, Part
from ce.look import Look
from ce.normal import Normal
from ce.product import Product
from ce.white import White

FORMAT = 3


class Batch(msgspec.Struct, frozen=True, eq=False):
    """Rows [start, stop) of the stream (seed, phase, iteration), to be answered by one f each.

    x: (n, d) float64; noise: (n,) uint64, a rollout's own seed; parameters: of the proposal, so that a
    worker holding the base can draw the same rows alone: `draw(base.with_parameters(parameters), seed,
    phase, iteration, start, stop)`. explicit: x is not such a draw but has to travel with the batch; parameters
    then only describe it.
    """

    phase: str
    iteration: int
    x: NDArray[np.float64]
    noise: NDArray[np.uint64]
    parameters: NDArray[np.float64]
    seed: int
    start: int
    stop: int
    explicit: bool = False


class TrainingRecord(msgspec.Struct, frozen=True):
    """One iteration of the search.

    quantile: rho-quantile of f under the sampled proposal; gamma_k = max(gamma, quantile), or the largest
    finite f where the quantile is infinite; elites: rollouts with f <= gamma_k; ess, max_weight_share: of
    their weights p0/p_theta; events: rollouts with f <= gamma; infinite, failed: rollouts with f = +inf, f
    = NaN; step: the step taken (0 = the proposal stayed); kl: KL(sampled proposal || base), nats; summary:
    of the sampled proposal's parameters.
    """

    iteration: int
    rollouts: int
    gamma_k: float
    quantile: float
    elites: int
    ess: float
    max_weight_share: float
    events: int
    infinite: int
    failed: int
    step: float
    kl: float
    summary: dict[str, float]
    phase: str = "train"


class EstimationRecord(msgspec.Struct, frozen=True):
    """The estimate after one more batch of estimation rollouts."""

    iteration: int
    rollouts: int
    p: float
    std_error: float
    low: float
    high: float
    ess: float
    max_weight_share: float
    events: int
    failed: int
    phase: str = "estimate"


class NaiveState(msgspec.Struct, frozen=True, eq=False):
    """Naive Monte Carlo: f so far, (n,), and the rollout count at which to look at the precision next."""

    digest: str
    seed: int
    f: NDArray[np.float64]
    look_at: int
    done: bool
    trial: int = 0  # rollouts at the beginning that only plan the others (`ce.stopping`)
    looks: int = 0
    method: str = "naive"
    format: int = FORMAT


class CrossEntropyState(msgspec.Struct, frozen=True, eq=False):
    """Algorithm 1: the proposal being used, the best one met, the records, then the estimation rollouts' f
    and log w.
    """

    digest: str
    seed: int
    phase: str  # "train", "estimate" or "done"
    iteration: int
    parameters: NDArray[np.float64]
    best_parameters: NDArray[np.float64]
    best_quantile: float
    records: tuple[TrainingRecord, ...]
    failed: tuple[tuple[int, int], ...]  # (iteration, row) of failed training rollouts
    f: NDArray[np.float64]
    log_weights: NDArray[np.float64]
    base_f: NDArray[np.float64]  # f of the first iteration, whose rollouts come from the base itself
    look_at: int
    trial: int = 0  # rollouts at the beginning of the fresh sample that only plan the others (`ce.stopping`)
    looks: int = 0
    method: str = "ce"
    format: int = FORMAT


class MixtureState(msgspec.Struct, frozen=True, eq=False):
    """Mixture sampling: the proposals so far, the last two fits, the elites in standard-normal space, the look for what
    they miss and what it has found, the records, then the estimation rollouts' f and log w.
    """

    digest: str
    seed: int
    phase: str  # "train", "look", "estimate" or "done"
    iteration: int  # batches of the search answered, those of the look among them
    mixtures: tuple[Mixture, ...]
    fits: tuple[Part, ...]
    parameters: NDArray[np.float64]
    level: float
    least_quantile: float
    reached_at: int  # fit whose rho-quantile was first an event, -1 for none
    improved_at: int
    elite_u: NDArray[np.float64]
    elite_f: NDArray[np.float64]
    look: Look | None
    found: Part | None  # where the look has met events that no proposal covered
    coverage: float  # of the look's states by the last proposal; NaN: no look
    worths: tuple[float, ...]  # effective events a rollout of each batch since the threshold was reached
    headway: tuple[float, ...]  # of the proposal of each batch of the search, at the level it was fitted to
    shares: tuple[float, ...]  # p by each batch of the search alone
    records: tuple[TrainingRecord, ...]
    failed: tuple[tuple[int, int], ...]
    f: NDArray[np.float64]
    log_weights: NDArray[np.float64]
    base_f: NDArray[np.float64]
    look_at: int
    trial: int = 0
    looks: int = 0
    method: str = "mixture"
    format: int = FORMAT


class SplittingState(msgspec.Struct, frozen=True, eq=False):
    """Splitting: levels and steps; the chains, whose next move is the next batch; the pool, the present level's
    sample so far (after the pilot only what the next level may grow from); and f with log weight and replication
    of what the finished levels leave behind.
    """

    digest: str
    seed: int
    phase: str  # "pilot", "run" or "done"
    batches: int  # answered
    rollouts: int
    training_rollouts: int
    size: int  # samples of a level in a run
    replications: int
    side_by_side: int  # replications of a group
    group: int
    level: int
    position: int  # states of the present chains
    levels: NDArray[np.float64]
    steps: NDArray[np.float64]  # (levels, d)
    step: float  # the pilot's common factor
    chain_u: NDArray[np.float64]
    chain_f: NDArray[np.float64]
    chain_noise: NDArray[np.uint64]
    chain_run: NDArray[np.int64]
    pool_u: NDArray[np.float64]
    pool_f: NDArray[np.float64]
    pool_noise: NDArray[np.uint64]
    pool_run: NDArray[np.int64]
    run_log_p: NDArray[np.float64]  # log P(f <= present level) by each run of the group
    accepted: float
    f: NDArray[np.float64]
    log_weights: NDArray[np.float64]
    replication: NDArray[np.int64]
    base_f: NDArray[np.float64]
    failed: tuple[tuple[int, int], ...]
    reached: bool
    method: str = "splitting"
    format: int = FORMAT


class AutoState(msgspec.Struct, frozen=True):
    """Method auto: the stage, what earlier stages have cost, whether the trial is over, and the stage's own state."""

    digest: str
    seed: int
    stage: str  # "mixture", "naive" or "splitting"
    spent: int
    tried: bool
    inner: bytes
    failed: tuple[tuple[str, int, int], ...]
    reason: str  # why another stage was left for this one
    method: str = "auto"
    format: int = FORMAT


def _encode_array(value: Any) -> Any:
    if isinstance(value, np.ndarray):
        little = np.ascontiguousarray(value, dtype=value.dtype.newbyteorder("<"))
        return {"dtype": little.dtype.str, "shape": little.shape, "data": little.tobytes()}
    if isinstance(value, np.generic):
        return value.item()
    raise NotImplementedError(f"cannot encode {type(value).__name__}")


def _decode_array(kind: type, value: Any) -> Any:
    array = np.frombuffer(value["data"], dtype=np.dtype(value["dtype"])).reshape(value["shape"])
    return array.astype(array.dtype.newbyteorder("="))


_encoder = msgspec.msgpack.Encoder(enc_hook=_encode_array)


def to_bytes(state: msgspec.Struct) -> bytes:
    """The state as MessagePack."""
    return _encoder.encode(state)


def from_bytes(data: bytes, kind: type, digest: str) -> Any:
    """The state of that kind, checked to belong to the problem with that digest; StateError otherwise."""
    state: Any
    try:
        state = msgspec.msgpack.decode(data, type=kind, dec_hook=_decode_array)
    except (msgspec.MsgspecError, KeyError, TypeError, ValueError) as error:
        _refuse_other_formats(_format_of(data))
        raise StateError(f"these bytes are not a {kind.__name__}: {error}") from None
    _refuse_other_formats(state.format)
    if state.digest != digest:
        raise StateError(
            "the state belongs to another base distribution, gamma or options; give the same ones"
        )
    return state


class _Format(msgspec.Struct):
    """What every state of whatever version has."""

    format: int


def _format_of(data: bytes) -> int | None:
    try:
        return msgspec.msgpack.decode(data, type=_Format).format
    except (msgspec.MsgspecError, ValueError):
        return None


def _refuse_other_formats(found: int | None) -> None:
    if found not in (None, FORMAT):
        raise StateError(f"the state has format {found}, this version reads {FORMAT}")


def digest_of(base: Product, *rest: Any) -> str:
    """SHA-256 over the base distribution's numbers and whatever else defines the problem."""
    described: list[list[Any]] = []
    for b in base.blocks:
        if isinstance(b, Beta):
            described.append(["beta", b.alpha, b.beta, b.low, b.high])
        elif isinstance(b, White):
            described.append(["white", b.mean])
        elif isinstance(b, Normal):
            described.append(["normal", b.mean, b.cov])
        else:
            names = [f.name for f in fields(b)]  # type: ignore[arg-type]
            described.append([type(b).__name__, *(getattr(b, name) for name in names)])
    return hashlib.sha256(_encoder.encode([described, *rest])).hexdigest()
