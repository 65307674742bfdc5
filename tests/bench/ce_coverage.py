"""Coverage and efficiency of `ce` on problems with exact probabilities, over many seeds.

Run from the repository root: python -m tests.bench.ce_coverage [SEEDS]. Minutes. Prints one line a problem
and method: bias and root-mean-square error relative to p, mean and standard deviation of z = (p_hat - p) /
std_error, how often the interval held p (of all runs, and of runs without a warning), how many runs carried
a warning, and the efficiency (p (1 - p) / calls of f) / mean squared error, training counted.
"""

import sys

import numpy as np

import ce
from tests.reference.problems import BETAS, CORRELATED, LINEAR_2, LINEAR_404, Problem

METHODS: dict[str, tuple[str, ce.CrossEntropyOptions | ce.NaiveOptions | None]] = {
    "naive": ("naive", ce.NaiveOptions(budget=20_000)),
    "ce, paper's constraints": ("ce", ce.CrossEntropyOptions(budget=20_000)),
    "ce, no mean box": ("ce", ce.CrossEntropyOptions(budget=20_000, mean_box=None)),
    "ce, general": ("ce", ce.general_options(20_000)),
    "ce, general, 100,000": ("ce", ce.general_options(100_000)),
    "ce, general, rel_error 0.1": ("ce", ce.general_options(100_000, rel_error=0.1)),
}


def row(problem: Problem, name: str, seeds: int) -> str:
    method, options = METHODS[name]
    runs = [
        ce.estimate(problem.f, problem.base, problem.gamma, method, options=options, seed=seed)
        for seed in range(seeds)
    ]
    p = np.array([e.p for e in runs])
    covered = np.array([e.ci[0] <= problem.p <= e.ci[1] for e in runs])
    warned = np.array([any(w.name != "precision-not-reached" for w in e.warnings) for e in runs])
    z = np.array([(e.p - problem.p) / e.std_error for e in runs if e.std_error > 0])
    calls = float(np.mean([e.rollouts for e in runs]))
    mean_square = float(np.mean((p - problem.p) ** 2))
    unwarned = f"{covered[~warned].mean():6.1%}" if (~warned).any() else "     -"
    bias, rmse = p.mean() / problem.p - 1, mean_square**0.5 / problem.p
    efficiency = problem.p * (1 - problem.p) / calls / mean_square
    z_mean, z_sd = (z.mean(), z.std()) if z.size else (np.nan, np.nan)
    return (
        f"{problem.name:26} {name:28} calls {calls:7.0f}  bias {bias:+7.1%}  rmse {rmse:6.1%}  "
        f"z {z_mean:+.2f} +- {z_sd:.2f}  covered {covered.mean():6.1%} (unwarned {unwarned})  "
        f"warned {warned.mean():4.0%}  efficiency {efficiency:.3g}"
    )


def main() -> None:
    seeds = int(sys.argv[1]) if len(sys.argv) > 1 else 100
    for problem in (LINEAR_2, BETAS, CORRELATED, LINEAR_404):
        for name in METHODS:
            if problem is not BETAS and "paper's" in name:
                continue  # a box of 0.01 around means of deviation 1 moves next to nothing
            print(row(problem, name, seeds if problem is not LINEAR_404 else max(seeds // 4, 1)), flush=True)


if __name__ == "__main__":
    main()
