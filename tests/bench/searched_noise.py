"""What it is worth that splitting moves the noise: a problem with a known answer, half of which lies in the noise.

    python -m tests.bench.searched_noise [SEEDS] [CALLS]

f = -(a . u + b . z) / sqrt(2) with u the starts and weights in standard-normal space, z the noise, a and b unit
vectors: p = P(f <= -beta) = Phi(-beta). "drawn": a rollout's noise comes from its seed, and a move keeps the seed or
draws a fresh one; "searched": the noise is a part of x. Prints one line for each p and kind.
"""

from __future__ import annotations

import math
import sys

import numpy as np
from scipy.special import ndtr, ndtri

import ce
from ce.standard import to_standard

STARTS, WEIGHTS, NOISE = 24, 40, 300
PROBABILITIES = (1e-4, 1e-5, 1e-6)


def base_of(searched: bool) -> ce.Product:
    blocks = [ce.Beta(2.0, 2.0) for _ in range(STARTS)] + [ce.Normal(np.zeros(WEIGHTS), np.eye(WEIGHTS))]
    return ce.Product([*blocks, ce.StandardNormal(NOISE)] if searched else blocks)


def noise_sums(seeds: np.ndarray) -> np.ndarray:
    """b . z of rollouts by their seeds: any one number does, as b is a unit vector."""
    return np.array([np.random.Generator(np.random.Philox(key=int(s))).standard_normal() for s in seeds])


def run(p: float, searched: bool, seed: int, calls: int) -> ce.Estimate:
    base = base_of(searched)
    algorithm = ce.algorithm("splitting", base, float(ndtri(p)), ce.SplittingOptions(budget=calls))
    state = algorithm.init(seed)
    own = STARTS + WEIGHTS
    while (batch := algorithm.propose(state)) is not None:
        u = to_standard(base, batch.x)
        known = u[:, :own].sum(axis=1) / math.sqrt(own)
        noise = u[:, own:].sum(axis=1) / math.sqrt(NOISE) if searched else noise_sums(batch.noise)
        state, _ = algorithm.update(state, batch, -(known + noise) / math.sqrt(2.0))
    return algorithm.estimate(state)


def told(p: float, searched: bool, seeds: int, calls: int) -> dict[str, float]:
    """Over the seeds: mean and root mean squared error over p, efficiency against naive, coverage."""
    assert math.isclose(float(ndtr(ndtri(p))), p)
    found = [run(p, searched, seed, calls) for seed in range(seeds)]
    values = np.array([e.p for e in found])
    error = float(np.mean((values - p) ** 2))
    mean_calls = float(np.mean([e.rollouts for e in found]))
    return {
        "mean": float(values.mean()) / p,
        "error": math.sqrt(error) / p,
        # where the error is as large as p, always answering 0 would do as well
        "efficiency": p * (1.0 - p) / mean_calls / error if error < p**2 else math.nan,
        "covered": float(np.mean([e.ci[0] <= p <= e.ci[1] for e in found])),
        "warned": float(np.mean([bool(e.warnings) for e in found])),
    }


def main(seeds: int, calls: int) -> None:
    for p in PROBABILITIES:
        for searched in (False, True):
            line = told(p, searched, seeds, calls)
            kind = "searched" if searched else "drawn"
            print(f"p {p:.0e} {kind:8} " + " ".join(f"{k} {v:.3g}" for k, v in line.items()), flush=True)


if __name__ == "__main__":
    main(*(int(a) for a in (sys.argv[1:] + ["20", "5000"][len(sys.argv) - 1 :])[:2]))
