"""Two systems on common random numbers with any importance sampler: one search for both, one fresh sample for both."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ce.checks import checked_response
from ce.errors import OptionsError
from ce.product import Product
from ce.results import Estimate
from ce.run import algorithm, options_for

Array = NDArray[np.float64]

METHODS = ("naive", "ce", "mixture")


def paired(
    f_a: Callable[[Array], ArrayLike],
    f_b: Callable[[Array], ArrayLike],
    base: Product,
    gamma: float,
    method: str = "mixture",
    budget: int = 100_000,
    confidence: float = 0.95,
    seed: int = 0,
    options: Any = None,
) -> tuple[Estimate, Estimate]:
    """Estimates of p for both systems from the same rollouts, for `ce.compare`, which then pairs them.

    The search goes for min(f_a, f_b) <= gamma, the event that either fails; its fresh sample answers for each. Raises
    OptionsError for another method, and what `ce.estimate` raises.

    f_a: (n, d) -> (n,), of one system, as in `ce.estimate`
    f_b: (n, d) -> (n,), of the other, called with the same x
    base: distribution P0 of X
    gamma: threshold of the event, in the unit of f
    method: "naive", "ce" or "mixture" (splitting has no weights that two systems could share)
    budget: rows of each f, at most
    confidence: of the intervals, in (0, 1)
    seed: 0 <= seed < 2^64; same seed, same bits
    options: the method's own, in place of budget and confidence

    >>> import ce
    >>> base = ce.Product([ce.Normal([0.0], [[1.0]])])
    >>> a, b = ce.paired(lambda x: 4.0 - x[:, 0], lambda x: 4.1 - x[:, 0], base, gamma=0.0, budget=6000)
    >>> found = ce.compare(a, b)
    >>> found.paired, found.ratio_ci[0] < 1.5334 < found.ratio_ci[1]
    (True, True)
    """
    if method not in METHODS:
        raise OptionsError(f"systems can be paired with methods {', '.join(METHODS)}, not {method!r}")
    chosen = algorithm(method, base, gamma, options or options_for(method, budget, None, confidence))
    state = chosen.init(seed)
    sampled: list[tuple[Array, Array]] = []
    while (batch := chosen.propose(state)) is not None:
        a, b = checked_response(batch, f_a(batch.x)), checked_response(batch, f_b(batch.x))
        if batch.phase == "estimate":
            sampled.append((a, b))
        state, _ = chosen.update(state, batch, np.minimum(a, b))
    est = chosen.estimate(state)
    values = [np.concatenate(column)[-est.f.size :] for column in zip(*sampled, strict=True)]
    return replace(est, f=values[0]), replace(est, f=values[1])
