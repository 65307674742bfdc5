"""The method for paths on problems with a known probability, over many seeds: the table of `path_calibration.md`.

Run from the repository root: python -m tests.bench.path_calibration [--seeds 200] [--budget 20000] [--problem WORD
...] [--results FILE] [--table FILE] [--keep]. Half a minute a run. Each finished run is a line of the results file,
and runs that are already there are not done again; a results file that is not there begins as the runs kept in
`path_calibration.jsonl.xz`, which --keep writes anew. A line carries a digest of the sources of `ce.paths`
(docstrings, comments and longer texts apart); lines of an earlier version are left out of the table. Every run
trains its own committor.

Columns: runs; simulated steps, in whole paths, training included; relative bias and root-mean-square error; share of
intervals that hold p; share that hold it or carry a warning; share of runs with a warning; efficiency
p (1 - p) / (paths' worth of steps x mean squared error), and the same by paths begun.
"""

import argparse
import ast
import hashlib
import json
import lzma
from collections import defaultdict
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

import ce
from tests.reference.path_problems import PathProblem, all_problems

HERE = Path(__file__).parent
KEPT = HERE / "path_calibration.jsonl.xz"
COLUMNS = (
    "problem", "p", "budget", "runs", "steps", "bias", "rmse", "covered", "covered or warned", "warned", "efficiency",
    "by paths begun",
)  # fmt: skip

Runs = dict[tuple[str, int], list[dict[str, Any]]]


def version() -> str:
    """Digest of the sources of the method, without docstrings, comments and longer texts."""
    digest = hashlib.sha256()
    for source in sorted(Path(ce.paths.__file__).parent.glob("*.py")):
        tree = ast.parse(source.read_text(encoding="utf-8"))
        for node in ast.walk(tree):
            if isinstance(node, ast.Constant) and isinstance(node.value, str) and " " in node.value:
                node.value = ""
        digest.update(ast.dump(tree).encode())
    return digest.hexdigest()[:12]


def run(problem: PathProblem, budget: int, seed: int) -> dict[str, Any]:
    """One run as a flat record."""
    est = ce.estimate_paths(problem.process, problem.gamma, budget=budget, seed=seed)
    low, high = est.ci
    return {
        "p": est.p,
        "low": low,
        "high": high,
        "steps": est.cost.steps / est.cost.path_steps,
        "begun": est.cost.begun,
        "warned": sorted(w.name for w in est.warnings),
    }


def read(path: Path) -> Runs:
    """The runs on record of today's version."""
    done: Runs = defaultdict(list)
    today = version()
    for line in path.read_text(encoding="utf-8").splitlines() if path.exists() else ():
        try:
            record = json.loads(line)
        except json.JSONDecodeError:
            continue  # the line being written when the run was stopped
        if record["version"] == today:
            done[record["problem"], record["budget"]].append(record)
    return done


def row(problem: PathProblem, budget: int, runs: list[dict[str, Any]]) -> tuple[str, ...]:
    """A row of the table."""
    p = np.array([r["p"] if r["p"] == r["p"] else 0.0 for r in runs])
    steps = float(np.mean([r["steps"] for r in runs]))
    begun = float(np.mean([r["begun"] for r in runs]))
    square = float(np.mean((p - problem.p) ** 2))
    covered = np.array([r["low"] <= problem.p <= r["high"] for r in runs])
    warned = np.array([bool(r["warned"]) for r in runs])
    naive = problem.p * (1.0 - problem.p)
    return (
        problem.name,
        f"{problem.p:.2g}",
        f"{budget:,}",
        f"{len(runs)}",
        f"{steps:,.0f}",
        f"{p.mean() / problem.p - 1.0:+.1%}",
        f"{square**0.5 / problem.p:.1%}",
        f"{covered.mean():.1%}",
        f"{(covered | warned).mean():.1%}",
        f"{warned.mean():.0%}",
        f"{naive / steps / square:,.3g}",
        f"{naive / begun / square:,.3g}",
    )


def table(done: Runs) -> str:
    """The page."""
    lines = [
        "# The method for paths on problems with a known probability",
        "",
        "Written by `python -m tests.bench.path_calibration` (`make calibration`), which tells what the columns mean.",
        "",
        "| " + " | ".join(COLUMNS) + " |",
        "|" + " --- |" * len(COLUMNS),
    ]
    for problem in all_problems():
        for (name, budget), runs in sorted(done.items()):
            if name == problem.name:
                lines.append("| " + " | ".join(row(problem, budget, runs)) + " |")
    return "\n".join(lines) + "\n"


def main(arguments: list[str] | None = None, show: Callable[[str], None] = print) -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=200)
    parser.add_argument("--budget", type=int, nargs="+", default=[20_000])
    parser.add_argument(
        "--problem", nargs="+", default=[""], help="words of which a problem's name holds one"
    )
    parser.add_argument("--results", type=Path, default=Path("build/path_calibration.jsonl"))
    parser.add_argument("--table", type=Path, default=HERE / "path_calibration.md")
    parser.add_argument("--keep", action="store_true", help=f"pack the runs into {KEPT.name} at the end")
    given = parser.parse_args(arguments)
    given.results.parent.mkdir(parents=True, exist_ok=True)
    if not given.results.exists() and KEPT.exists():
        given.results.write_bytes(lzma.decompress(KEPT.read_bytes()))
    done, today = read(given.results), version()
    todo = [
        (j, problem)
        for j, problem in enumerate(all_problems())
        if any(word in problem.name for word in given.problem)
    ]
    for first in range(given.seeds):
        for budget in given.budget:
            for j, problem in todo:
                seed, runs = 1000 * j + first, done[problem.name, budget]
                if any(r["seed"] == seed for r in runs):
                    continue
                record = {"problem": problem.name, "budget": budget, "seed": seed, "version": today}
                record |= run(problem, budget, seed)
                with given.results.open("a", encoding="utf-8") as out:
                    out.write(json.dumps(record) + "\n")
                runs.append(record)
                show(" | ".join(row(problem, budget, runs)))
    given.table.write_text(table(read(given.results)), encoding="utf-8")
    if given.keep:
        lines = [json.dumps(r, sort_keys=True) for key in sorted(done) for r in done[key]]
        KEPT.write_bytes(lzma.compress("".join(line + "\n" for line in lines).encode(), preset=9))


if __name__ == "__main__":
    main()
