"""`auto` on the problems of `tests/reference/variants.py`, which the calibration does not hold.

Run from the repository root: python -m tests.bench.ce_variants [--seeds 20] [--budget 20000] [--method auto]
[--problem WORD ...]. A second a seed and problem. Prints a row for each problem: runs, relative bias and
root-mean-square error, share of intervals that hold p, share that hold it or carry a warning, efficiency against naive
Monte Carlo at equal calls of f, the methods that `auto` ended with and how often each warning came.
"""

import argparse
from collections import Counter

import numpy as np

import ce
from tests.reference.problems import Problem
from tests.reference.variants import VARIANTS


def row(problem: Problem, method: str, budget: int, seeds: range) -> str:
    runs = [
        ce.estimate(problem.f, problem.base, problem.gamma, method, budget=budget, seed=seed)
        for seed in seeds
    ]
    relative = np.array([est.p / problem.p for est in runs])
    held = np.array([est.ci[0] <= problem.p <= est.ci[1] for est in runs])
    warned = np.array([bool(est.warnings) for est in runs])
    square = float(np.mean((relative - 1.0) ** 2))
    calls = float(np.mean([est.rollouts for est in runs]))
    by = Counter(est.method for est in runs)
    named = Counter(w.name for est in runs for w in est.warnings)
    name = problem.name.replace("|", "\\|")
    return (
        f"| {name} | {problem.p:.2g} | {len(runs)} | {relative.mean() - 1:+.1%} | {square**0.5:.1%} | "
        f"{held.mean():.0%} | {(held | warned).mean():.0%} | {(1 - problem.p) / problem.p / calls / square:.2g} | "
        f"{_counted(by)} | {_counted(named)} |"
    )


def _counted(counts: Counter[str]) -> str:
    return ", ".join(f"{name} {count}" for name, count in counts.most_common()) or "none"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--budget", type=int, default=20_000)
    parser.add_argument("--method", default="auto", choices=ce.METHODS)
    parser.add_argument("--problem", nargs="+", default=[""], help="words of which a name holds one")
    given = parser.parse_args()
    print("| problem | p | runs | bias | rmse | held | held or warned | efficiency | ended with | warnings |")
    print("| --- " * 10 + "|")
    for place, problem in enumerate(VARIANTS):
        if any(word in problem.name for word in given.problem):
            seeds = range(1000 * place, 1000 * place + given.seeds)
            print(row(problem, given.method, given.budget, seeds), flush=True)


if __name__ == "__main__":
    main()
