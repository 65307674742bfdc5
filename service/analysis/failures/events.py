"""The dangerous rollouts of a job, ranked by how likely they are."""

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, Literal, get_args

import numpy as np

import ce
from ce.weights import normalised
from service.errors import InputError
from service.evaluation.record import JobRecord
from service.world.scenario.noise import Noise

Order = Literal["likelihood", "weight", "f"]
ORDERS: tuple[Order, ...] = get_args(Order)
CHAINS = "train"  # what methods that move chains call the phase of all their batches


@dataclass(frozen=True)
class Events:
    """The rollouts with f <= gamma, or with the record's outcome, of the batches that the estimate is made of.

    By iteration and row; arrays (n,).

    log_likelihood: log p0(x), nats
    weight: p0(x) over the proposal's density, 1 for naive Monte Carlo and for methods that move chains
    share: of the estimate that the rollout carries
    replication: for methods that move chains, the independent replication that met it, and replicated: p of each
        replication
    """

    record: JobRecord
    phase: str
    iterations: np.ndarray
    rows: np.ndarray
    f: np.ndarray
    log_likelihood: np.ndarray
    weight: np.ndarray
    share: np.ndarray
    replication: np.ndarray | None = None
    replicated: np.ndarray | None = None

    def __len__(self) -> int:
        return int(self.rows.size)

    def ranking(self, order: Order) -> np.ndarray:
        """Positions (n,), the first ranks first: the likeliest, the heaviest, or the lowest f. Ties go by row."""
        keys = {"likelihood": -self.log_likelihood, "weight": -self.share, "f": self.f}
        if order not in keys:
            raise InputError(f"no order named {order!r}; there are {', '.join(keys)}")
        return np.lexsort((self.rows, self.iterations, keys[order]))

    def ranks(self, order: Order) -> dict[int, int]:
        """The rank of each position in an order of `ranking`, from 1 on."""
        return {position: rank for rank, position in enumerate(self.ranking(order).tolist(), start=1)}

    def located(self, i: int) -> dict[str, Any]:
        """Where the rollout at a position was drawn, its f and its share, as findings say it."""
        ((_, noise_seed),) = self.drawn([i])
        return {
            "iteration": int(self.iterations[i]),
            "row": int(self.rows[i]),
            "noise_seed": str(noise_seed),
            "f": float(self.f[i]),
            "share": float(self.share[i]),
        }

    def drawn(self, positions: Iterable[int]) -> list[tuple[np.ndarray, Noise]]:
        """x (d,) and noise of some of them, drawn again just as their batches were."""
        keys = [(int(self.iterations[i]), int(self.rows[i])) for i in positions]
        return self.record.redraw_all(self.phase, keys)


def starts_log_likelihood(base: ce.Product, x: np.ndarray) -> float:
    """log p0 of the vehicles' starts alone, nats; x (d,).

    Without the driver weights, in whose hundreds of dimensions typical draws differ by tens of nats whatever they do.
    """
    drivers = sum(float(block.log_density(x[None, at : at + block.dim])[0]) for at, block in base.normals)
    return float(base.log_density(x[None])[0]) - drivers


def events_of(record: JobRecord) -> Events:
    """The dangerous rollouts of a job."""
    estimate = record.estimate
    if isinstance(estimate, ce.PathEstimate):
        return _of_paths(record)
    if isinstance(estimate, ce.ReplicatedEstimate):
        return _of_chains(record)
    by_row = np.argsort(record.event_rows)
    rows = record.event_rows[by_row]
    log_weight = np.zeros(rows.size) if estimate.log_weights is None else estimate.log_weights[rows]
    return Events(
        record,
        "estimate",
        np.full(rows.size, record.estimate_iteration),
        rows,
        record.f[rows],
        record.event_log_likelihood[by_row],
        np.exp(log_weight),
        normalised(log_weight),
    )


def _of_paths(record: JobRecord) -> Events:
    """Of the method that drives paths: those with f <= gamma, each with its own weight; replications are batches."""
    estimate = record.estimate
    assert isinstance(estimate, ce.PathEstimate)
    at = np.flatnonzero(estimate.f <= estimate.gamma)
    batch = estimate.replication[at]
    rows = at - np.searchsorted(estimate.replication, batch)
    log_weight = np.zeros(at.size) if estimate.log_weights is None else estimate.log_weights[at]
    weight = np.exp(log_weight)
    found = [record.explicit["estimate", b, r] for b, r in zip(batch.tolist(), rows.tolist(), strict=True)]
    x = np.array([x for x, _, _ in found]).reshape(at.size, record.problem.base.dim)
    return Events(
        record,
        "estimate",
        batch,
        rows,
        estimate.f[at],
        record.problem.base.log_density(x),
        weight * estimate.starts,
        normalised(log_weight),
        batch,
        np.bincount(batch, weight, minlength=estimate.batches),
    )


def _of_chains(record: JobRecord) -> Events:
    """Of a method that moves chains: the dangerous rollouts that carry its estimate, each with its part of it.

    A chain stays where it is when a move is refused, and a level begins from survivors of the one before, so a rollout
    may stand in the estimate many times, once, or (met by the pilot, or handed on to a lower level) not at all. Its
    entries there are known by its f, which rollouts share only when they are the same to the bit.
    """
    estimate = record.estimate
    assert isinstance(estimate, ce.ReplicatedEstimate)
    wanted = math.inf if record.outcome is not None else estimate.gamma  # of an outcome nothing else is kept
    met = [k for k, (_, _, f) in record.explicit.items() if k[0] == CHAINS and f <= wanted]
    values = np.array([record.explicit[k][2] for k in met])
    share, replication, replicated = chain_shares(estimate, values, record.f)
    keys = sorted((k, i) for i, k in enumerate(met) if share[i] > 0.0)
    chosen = np.array([i for _, i in keys], dtype=np.int64)
    found = [record.explicit[k] for k, _ in keys]
    n = len(found)
    x = np.array([x for x, _, _ in found]).reshape(n, record.problem.base.dim)
    return Events(
        record,
        CHAINS,
        np.array([k[1] for k, _ in keys], dtype=np.int64),
        np.array([k[2] for k, _ in keys], dtype=np.int64),
        np.array([f for _, _, f in found]),
        record.problem.base.log_density(x),
        np.ones(n),
        share[chosen],
        replication[chosen],
        replicated,
    )


def chain_shares(
    estimate: ce.ReplicatedEstimate, met: np.ndarray, f: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """What the rollouts with values `met` (n,) carry of the estimate, whose own rollouts have the values f; None: the
    estimate's.

    Returns their shares (n,), which sum to one, 0 for those that the estimate does not hold; the replication of each
    (n,); and p of each replication. Rollouts of one and the same value share its part evenly.
    """
    f = estimate.f if f is None else f
    inside = estimate.f <= estimate.gamma
    weight = np.zeros(estimate.f.size) if estimate.log_weights is None else np.exp(estimate.log_weights)
    runs = int(estimate.replication.max()) + 1 if estimate.replication.size else 0
    replicated = np.bincount(estimate.replication[inside], weight[inside], minlength=runs)
    values, place, times = np.unique(met, return_inverse=True, return_counts=True)
    at = np.searchsorted(values, f[inside])
    known = at < values.size
    known[known] = values[at[known]] == f[inside][known]
    at, mine = at[known], weight[inside][known]
    carried = np.bincount(at, mine, minlength=values.size) / times
    run = np.zeros(values.size, dtype=np.int64)
    run[at] = estimate.replication[inside][known]
    share = carried[place]
    return share / max(share.sum(), 1e-300), run[place], replicated
