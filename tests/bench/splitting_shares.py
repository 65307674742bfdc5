"""Do the intervals of failure modes' shares hold, where splitting's Markov chains met the failures?

    python -m tests.bench.splitting_shares [--seeds 200]

Two ways to the event {x_1 > a} or {x_2 > b} of a standard normal x in 10 dimensions, of known shares. Beside the
intervals that are given (each rollout with its part of the estimate, spread over replications), those of counting the
rollouts that were met, as if they were worth the estimate's effective number.
"""

import argparse

import numpy as np
from scipy.integrate import quad
from scipy.special import ndtr, ndtri

from service.analysis.failures.events import chain_shares
from service.analysis.failures.shares import replicated_share, share_interval
from tests.reference.two_ways import met_by_splitting

DIMENSION = 10
PROBLEMS = {
    "even, p = 1e-3": (5e-4, 5e-4),
    "uneven, p = 1e-3": (9e-4, 1e-4),
    "rare, p = 2e-5": (1.4e-5, 6e-6),
}
BUDGET = 10_000


def main() -> None:
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options.add_argument("--seeds", type=int, default=200)
    seeds = options.parse_args().seeds
    print("| problem, share of the first | covered | mean width | covered, counting | mean width | seeds |")
    print("| --- | --- | --- | --- | --- | --- |")
    for name, (p_1, p_2) in PROBLEMS.items():
        a, b = float(-ndtri(p_1)), float(-ndtri(p_2))
        truth = true_share(a, b)
        told = [one(a, b, truth, seed) for seed in range(seeds)]
        held, width, held_before, width_before = np.mean([t for t in told if t is not None], axis=0)
        print(
            f"| {name}, {truth:.3f} | {held:.1%} | {width:.2f} | {held_before:.1%} | {width_before:.2f} | {seeds} |"
        )


def true_share(a: float, b: float) -> float:
    """Of the event, in which x_1 - a > x_2 - b."""

    def density(x: float, own: float, other: float) -> float:
        return float(np.exp(-0.5 * x * x) * ndtr(x - own + other))

    first = quad(density, a, a + 12.0, args=(a, b), epsrel=1e-10)[0]
    second = quad(density, b, b + 12.0, args=(b, a), epsrel=1e-10)[0]
    return first / (first + second)


def one(a: float, b: float, truth: float, seed: int) -> tuple[float, float, float, float] | None:
    """Whether the interval holds the truth and its width, for both ways; None where no event was met."""
    estimate, met, mine = met_by_splitting(a, b, DIMENSION, BUDGET, seed)
    share, replication, replicated = chain_shares(estimate, met)
    if not share.sum() > 0.0:
        return None
    inside = share > 0.0
    _, low, high = replicated_share(mine[inside], share[inside], replication[inside], replicated, 0.95)
    _, low_before, high_before = counting(mine, estimate.ess)
    return low <= truth <= high, high - low, low_before <= truth <= high_before, high_before - low_before


def counting(member: np.ndarray, worth: float) -> tuple[float, float, float]:
    """Every rollout that was met counts one; together they are worth so many."""
    n = max(min(round(worth), member.size), 1)
    k = round(float(member.mean()) * n)
    return share_interval(np.arange(n) < k, np.ones(n), 0.95)


if __name__ == "__main__":
    main()
