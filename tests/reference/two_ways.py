"""The event {x_1 > a} or {x_2 > b} of a standard normal x, as splitting meets it, with the way of each failure."""

import numpy as np

import ce


def met_by_splitting(
    a: float, b: float, dimension: int, budget: int, seed: int
) -> tuple[ce.Estimate, np.ndarray, np.ndarray]:
    """The estimate; f of every rollout that met the event; whether it did so by x_1 (x_1 - a > x_2 - b)."""
    base = ce.Product([ce.Normal(np.zeros(dimension), np.eye(dimension))])
    algorithm = ce.algorithm("splitting", base, 0.0, ce.SplittingOptions(budget=budget))
    state = algorithm.init(seed)
    met: list[float] = []
    member: list[bool] = []
    while (batch := algorithm.propose(state)) is not None:
        first, second = a - batch.x[:, 0], b - batch.x[:, 1]
        f = np.minimum(first, second)
        met += f[f <= 0.0].tolist()
        member += (first < second)[f <= 0.0].tolist()
        state, _ = algorithm.update(state, batch, f)
    return algorithm.estimate(state), np.array(met), np.array(member)
