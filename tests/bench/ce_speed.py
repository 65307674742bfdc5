"""What the algorithms themselves cost beside the rollouts: time of an update and memory of the process.

Run from the repository root: python -m tests.bench.ce_speed [update | memory] [--method M ...]. `update`: the slowest
update of each method for d = 452 (24 Betas and 428 Normals) with 5,000 samples an iteration, in processor seconds on
one core. `memory`: the largest resident memory of a process that runs a method over 10^6 samples (minutes).
"""

import argparse
import resource
import subprocess
import sys
import time
from typing import Any

import numpy as np

import ce

BETAS, NORMALS = 24, 428
SAMPLES, MANY = 5000, 1_000_000


def base() -> ce.Product:
    source = np.random.default_rng(0)
    loadings = 0.1 * source.standard_normal((NORMALS, 8))
    cov = np.eye(NORMALS) + loadings @ loadings.T
    return ce.Product([*(ce.Beta(2.0, 2.0) for _ in range(BETAS)), ce.Normal(np.zeros(NORMALS), cov)])


def f(x: np.ndarray) -> np.ndarray:
    """Two starts that must meet, and all weights a little."""
    return 0.5 + np.abs(x[:, 0] - x[:, 1]) + x[:, 2] - 0.05 * x[:, BETAS:].sum(axis=1) / np.sqrt(NORMALS)


def options(method: str, budget: int) -> Any:
    if method == "ce":
        return ce.CrossEntropyOptions(
            budget=budget, iterations=4, samples_per_iteration=SAMPLES, rho=0.1, mean_box=None, max_kl=8.0
        )
    if method == "mixture":
        return ce.MixtureOptions(budget=budget, samples_per_iteration=SAMPLES)
    return ce.OPTIONS[method](budget=budget)


def run(method: str, budget: int) -> tuple[float, float, ce.Estimate]:
    """Slowest update and slowest proposal in processor seconds, and the estimate."""
    algorithm = ce.algorithm(method, base(), 0.45, options(method, budget))
    state = algorithm.init(0)
    slowest = slowest_proposal = 0.0
    while True:
        began = time.process_time()
        batch = algorithm.propose(state)
        if batch is None:
            break
        slowest_proposal = max(slowest_proposal, time.process_time() - began)
        values = f(batch.x)
        began = time.process_time()
        state, _ = algorithm.update(state, batch, values)
        slowest = max(slowest, time.process_time() - began)
    return slowest, slowest_proposal, algorithm.estimate(state)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("what", choices=("update", "memory"), nargs="?", default="update")
    parser.add_argument("--method", nargs="+", default=list(ce.METHODS))
    parser.add_argument("--alone", action="store_true", help="in this process, whose memory is then printed")
    given = parser.parse_args()
    for method in given.method:
        if given.what == "update":
            slowest, proposal, est = run(method, 60_000)
            print(
                f"{method:10} update {slowest:.2f} s, proposal {proposal:.2f} s, p = {est.p:.3g}", flush=True
            )
        elif given.alone:
            _, _, est = run(method, MANY)
            peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
            print(
                f"{method:10} {est.rollouts} samples, {peak:.0f} MB, curve {est.curve([0.45, 0.6]).p}",
                flush=True,
            )
        else:
            command = [sys.executable, "-m", "tests.bench.ce_speed", "memory", "--alone", "--method", method]
            subprocess.run(command, check=True)


if __name__ == "__main__":
    main()
