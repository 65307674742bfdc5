"""The dangerous rollouts of a job, ranked by how likely they are."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np

import ce
from ce.weights import normalised
from service.errors import InputError
from service.record import JobRecord

Order = Literal["likelihood", "weight", "f"]
ORDERS: tuple[Order, ...] = get_args(Order)
CHAINS = "train"  # what methods that move chains call the phase of all their batches


@dataclass(frozen=True)
class Events:
    """The rollouts with f <= gamma of the batches that the estimate is made of, by iteration and row. Arrays (n,).

    log_likelihood: log p0(x), nats; weight: p0(x) over the proposal's density, 1 for naive Monte Carlo and for methods
    that move chains; share: of the estimate that the rollout carries.
    """

    record: JobRecord
    phase: str
    iterations: np.ndarray
    rows: np.ndarray
    f: np.ndarray
    log_likelihood: np.ndarray
    weight: np.ndarray
    share: np.ndarray

    def __len__(self) -> int:
        return int(self.rows.size)

    def ranking(self, order: Order) -> np.ndarray:
        """Positions (n,), the first ranks first: the likeliest, the heaviest, or the lowest f. Ties go by row."""
        keys = {"likelihood": -self.log_likelihood, "weight": -self.weight, "f": self.f}
        if order not in keys:
            raise InputError(f"no order named {order!r}; there are {', '.join(keys)}")
        return np.lexsort((self.rows, self.iterations, keys[order]))

    def drawn(self, positions: Iterable[int]) -> list[tuple[np.ndarray, int]]:
        """x (d,) and noise seed of some of them, drawn again just as their batches were."""
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
        estimate.f[rows],
        record.event_log_likelihood[by_row],
        np.exp(log_weight),
        normalised(log_weight),
    )


def _of_chains(record: JobRecord) -> Events:
    """Of a method that moves chains: every dangerous rollout that it has met, all of one weight."""
    keys = [k for k, (_, _, f) in record.explicit.items() if k[0] == CHAINS and f <= record.estimate.gamma]
    keys.sort()
    met = [record.explicit[k] for k in keys]
    n = len(met)
    x = np.array([x for x, _, _ in met]).reshape(n, record.problem.base.dim)
    return Events(
        record,
        CHAINS,
        np.array([k[1] for k in keys], dtype=np.int64),
        np.array([k[2] for k in keys], dtype=np.int64),
        np.array([f for _, _, f in met]),
        record.problem.base.log_density(x),
        np.ones(n),
        np.full(n, 1.0 / max(n, 1)),
    )
