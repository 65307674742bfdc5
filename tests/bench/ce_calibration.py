"""Every method on every problem with a known probability, over many seeds: the table of `ce_calibration.md`.

Run from the repository root: python -m tests.bench.ce_calibration [--seeds 200] [--budget 20000 ...] [--method M ...]
[--problem WORD ...] [--results FILE] [--table FILE]. An hour or more. Each finished run is a line of the results
file, and runs that are already there are not done again, so it can be stopped and started at will. Where OpenTURNS
is installed (`pip install openturns`; not a dependency), its cross-entropy, NAIS and subset sampling are run on the
same problems with --method ot-ce, ot-nais, ot-subset.

Columns: calls of f; relative bias and root-mean-square error; share of intervals that hold p, of all runs and of
those without a warning; share of runs with a warning; efficiency p (1 - p) / (calls mean squared error).
"""

import argparse
import json
import math
from collections import defaultdict
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

import ce
from tests.reference import traffic
from tests.reference.problems import ALL, Problem

HERE = Path(__file__).parent
PROBLEMS = (*ALL, Problem("four modes among driver weights", traffic.base(), traffic.f, 0.0, traffic.P))
OPENTURNS = ("ot-ce", "ot-nais", "ot-subset")


def run(problem: Problem, method: str, budget: int, seed: int) -> dict[str, Any]:
    """One run as a flat record."""
    if method in OPENTURNS:
        return openturns(problem, method, budget, seed)
    est = ce.estimate(problem.f, problem.base, problem.gamma, method, budget=budget, seed=seed)
    warned = sorted(w.name for w in est.warnings)
    low, high = est.ci
    return {"p": est.p, "low": low, "high": high, "calls": est.rollouts, "warned": warned, "by": est.method}


def openturns(problem: Problem, method: str, budget: int, seed: int) -> dict[str, Any]:
    """The same by OpenTURNS, in standard-normal space, with blocks of a tenth of the budget for each level."""
    import openturns as ot

    from ce.standard import from_standard

    ot.RandomGenerator.SetSeed(seed)
    d = problem.base.dim
    calls = 0

    def f(u: Any) -> Any:
        nonlocal calls
        u = np.array(u)
        calls += u.shape[0]
        return problem.f(from_standard(problem.base, u)).reshape(-1, 1)

    vector = ot.RandomVector(ot.Normal(d))
    output = ot.CompositeRandomVector(ot.PythonFunction(d, 1, func_sample=f), vector)
    event = ot.ThresholdEvent(output, ot.LessOrEqual(), problem.gamma)
    size = budget // 10
    if method == "ot-nais":
        algorithm = ot.NAIS(event, 0.1)
    elif method == "ot-ce":
        algorithm = ot.StandardSpaceCrossEntropyImportanceSampling(event, 0.1)
    else:
        algorithm = ot.SubsetSampling(event)
    algorithm.setMaximumOuterSampling(size)
    algorithm.setBlockSize(1)
    algorithm.run()
    result = algorithm.getResult()
    p, half = result.getProbabilityEstimate(), 0.5 * result.getConfidenceLength(0.95)
    return {"p": p, "low": p - half, "high": p + half, "calls": calls, "warned": [], "by": method}


def rows(problem: Problem, runs: list[dict[str, Any]]) -> str:
    p = np.array([r["p"] for r in runs])
    covered = np.array([r["low"] <= problem.p <= r["high"] for r in runs])
    warned = np.array([bool(r["warned"]) for r in runs])
    calls = float(np.mean([r["calls"] for r in runs]))
    mean_square = float(np.mean((p - problem.p) ** 2))
    efficiency = problem.p * (1 - problem.p) / calls / mean_square if mean_square > 0 else math.inf
    calm = f"{covered[~warned].mean():.0%}" if (~warned).any() else "-"
    return (
        f"{len(runs)} | {calls:,.0f} | {p.mean() / problem.p - 1:+.1%} | {mean_square**0.5 / problem.p:.1%} | "
        f"{covered.mean():.0%} | {calm} | {warned.mean():.0%} | {efficiency:.2g}"
    )


def table(done: dict[tuple[str, str, int], list[dict[str, Any]]]) -> str:
    lines = [
        "# Calibration of `ce`",
        "",
        "Written by `make calibration` (`tests/bench/ce_calibration.py`, which explains the columns).",
        "",
        "| problem | p | method | budget | runs | calls of f | bias | rmse | covered | covered, no warning | warned "
        "| efficiency |",
        "| --- | --- | --- | --- | --- | --- | --- | --- | --- | --- | --- | --- |",
    ]
    for problem in PROBLEMS:
        for (name, method, budget), runs in sorted(done.items(), key=lambda item: (item[0][2], item[0][1])):
            if name == problem.name:
                shown = name.replace("|", "\\|")
                lines.append(f"| {shown} | {problem.p:.3g} | {method} | {budget:,} | {rows(problem, runs)} |")
    return "\n".join(lines) + "\n"


def read(path: Path) -> dict[tuple[str, str, int], list[dict[str, Any]]]:
    done: dict[tuple[str, str, int], list[dict[str, Any]]] = defaultdict(list)
    for line in path.read_text().splitlines() if path.exists() else ():
        try:
            record = json.loads(line)
        except json.JSONDecodeError:
            continue  # the line being written when the run was stopped
        done[record["problem"], record["method"], record["budget"]].append(record)
    return done


def _append(path: Path, line: str) -> None:
    """A line of its own, also where the last one was cut short."""
    cut = path.exists() and path.read_bytes()[-1:] not in (b"", b"\n")
    with path.open("a") as out:
        out.write(("\n" if cut else "") + line + "\n")


def main(arguments: list[str] | None = None, show: Callable[[str], None] = print) -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=200)
    parser.add_argument("--budget", type=int, nargs="+", default=[20_000])
    parser.add_argument("--method", nargs="+", default=list(ce.METHODS))
    parser.add_argument(
        "--problem", nargs="+", default=[""], help="words of which a problem's name holds one"
    )
    parser.add_argument("--results", type=Path, default=Path("build/ce_calibration.jsonl"))
    parser.add_argument("--table", type=Path, default=HERE / "ce_calibration.md")
    given = parser.parse_args(arguments)
    given.results.parent.mkdir(parents=True, exist_ok=True)
    for budget in given.budget:
        for problem in PROBLEMS:
            if not any(word in problem.name for word in given.problem):
                continue
            for method in given.method:
                had = {r["seed"] for r in read(given.results)[problem.name, method, budget]}
                for seed in sorted(set(range(given.seeds)) - had):
                    record = {"problem": problem.name, "method": method, "budget": budget, "seed": seed}
                    record |= run(problem, method, budget, seed)
                    _append(given.results, json.dumps(record))
                runs = read(given.results)[problem.name, method, budget]
                show(f"{problem.name:32} {method:10} {budget:7} | {rows(problem, runs)}")
                given.table.write_text(table(read(given.results)))


if __name__ == "__main__":
    main()
