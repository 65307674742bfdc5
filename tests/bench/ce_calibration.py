"""Every method on every problem with a known probability, over many seeds: the table of `ce_calibration.md`.

Run from the repository root: python -m tests.bench.ce_calibration [--seeds 200] [--seeds-large N] [--budget 20000
...] [--method M ...] [--problem WORD ...] [--results FILE] [--table FILE] [--keep]. Hours in all. Each finished run
is a line of the results file, and runs that are already there are not done again, so it can be stopped and started at
will; a results file that is not there begins as the runs kept in `ce_calibration.jsonl.xz`, which --keep writes anew.
A line carries a digest of the sources that its method is made of (docstrings, comments and messages apart): lines of
an earlier version of the algorithm are left out of the table and their runs are made again, unless --renew finds runs
made again unchanged: to the bit on the processor that made them, and to SAME in p and its interval on another, whose
BLAS adds up in another order. --seeds-large: seeds in a hundred dimensions and more (as --seeds, if not given).
Problem number j has seeds 1000 j, 1000 j + 1, ...: a method's normals depend on the seed alone, so with the same seeds
a lucky one would be lucky in every row. A run of `mixture` is that of `auto` with the same seed where `auto` has stayed
with it, and is then taken from there.

Other libraries on the same problems (`make calibration-peers`): OpenTURNS with its cross-entropy, NAIS and subset
sampling (--method ot-ce, ot-nais, ot-subset), UQpy with its subset simulation (uqpy-subset), each as its manual has it.
Not all of these end: a run has TIME_LIMIT_S of processor time and CALL_LIMIT times the budget, and after HOPELESS runs
in a row that hit a limit or crash the rest is left out.

Columns: runs, and in brackets those that did not end or crashed, which no other column counts; calls of f; relative
bias and root-mean-square error; share of intervals that hold p, of all runs; share that hold it or carry a warning;
share that hold it of the runs without a warning; share of runs with a warning; efficiency p (1 - p) / (calls mean
squared error).
"""

import argparse
import ast
import hashlib
import json
import lzma
import math
import signal
import sys
from collections import defaultdict
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

import ce
from ce.run import KINDS
from tests.bench.ce_peers import PEERS, peer, peer_version
from tests.reference import traffic
from tests.reference.problems import ALL, Problem
from tests.reference.variants import two_sided

HERE = Path(__file__).parent
PROBLEMS = (
    *ALL,
    Problem("four modes among driver weights", traffic.base(), traffic.f, 0.0, traffic.P),
    two_sided(2, 4.5),
    two_sided(100, 4.0),
)
SEEDS = {problem.name: 1000 * j for j, problem in enumerate(PROBLEMS)}  # first seed of each
KEPT = HERE / "ce_calibration.jsonl.xz"
LARGE = 100  # dimensions
BLOCK = 10  # seeds after which the next problem has its turn
TIME_LIMIT_S, CALL_LIMIT, HOPELESS = 60, 20, 3
SAME = 1e-7  # relative

COLUMNS = (
    "problem", "p", "method", "budget", "runs", "calls of f", "bias", "rmse", "covered", "covered or warned",
    "covered, no warning", "warned", "efficiency",
)  # fmt: skip

Key = tuple[str, str, int]
Runs = dict[Key, list[dict[str, Any]]]


def version(method: str) -> str:
    """Digest of the sources behind a method: the modules of `ce` that its own imports, without docstrings, comments and
    longer texts."""
    if method in PEERS:
        return peer_version(method)
    seen: set[str] = set()
    todo = [KINDS[method][0].__module__]
    digest = hashlib.sha256()
    while todo:
        name = todo.pop()
        if name in seen:
            continue
        seen.add(name)
        for node in ast.walk(_source(name)):
            if isinstance(node, ast.ImportFrom) and node.module and node.module.split(".")[0] == "ce":
                inner = [f"{node.module}.{a.name}" for a in node.names]
                todo += [m for m in (*inner, node.module) if m in sys.modules and m != "ce"]
    for name in sorted(seen):
        tree = _source(name)
        for node in ast.walk(tree):
            if isinstance(node, ast.Constant) and isinstance(node.value, str) and " " in node.value:
                node.value = ""
        digest.update(ast.dump(tree).encode())
    return digest.hexdigest()[:12]


def _source(module: str) -> ast.Module:
    return ast.parse(Path(str(sys.modules[module].__file__)).read_text())


def run(problem: Problem, method: str, budget: int, seed: int) -> dict[str, Any]:
    """One run as a flat record; `ended` says why there is no p."""
    if method in PEERS:
        return peer(problem, method, budget, seed, CALL_LIMIT * budget)
    est = ce.estimate(problem.f, problem.base, problem.gamma, method, budget=budget, seed=seed)
    warned = sorted(w.name for w in est.warnings)
    low, high = est.ci
    return {"p": est.p, "low": low, "high": high, "calls": est.rollouts, "warned": warned, "by": est.method}


def limited(problem: Problem, method: str, budget: int, seed: int) -> dict[str, Any]:
    """`run`, ended by the clock or an error of a peer's, which the record then says."""
    if method not in PEERS:
        return run(problem, method, budget, seed)

    def stop(*_: object) -> None:
        raise TimeoutError(f"more than {TIME_LIMIT_S} s of processor time")

    before = signal.signal(signal.SIGPROF, stop)
    signal.setitimer(signal.ITIMER_PROF, TIME_LIMIT_S)
    try:
        return run(problem, method, budget, seed)
    except Exception as error:  # whatever a peer raises is a result here
        return {
            "p": None,
            "low": 0.0,
            "high": 1.0,
            "calls": 0,
            "warned": [],
            "by": method,
            "ended": repr(error)[:200],
        }
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        signal.signal(signal.SIGPROF, before)


def rows(problem: Problem, runs: list[dict[str, Any]]) -> str:
    ended = [r for r in runs if r["p"] is not None]
    count = f"{len(ended)}" + (f" ({len(runs) - len(ended)})" if len(ended) < len(runs) else "")
    if not ended:
        return f"{count} | - | - | - | - | - | - | - | -"
    p = np.array([r["p"] for r in ended])
    covered = np.array([r["low"] <= problem.p <= r["high"] for r in ended])
    warned = np.array([bool(r["warned"]) for r in ended])
    calls = float(np.mean([r["calls"] for r in ended]))
    mean_square = float(np.mean((p - problem.p) ** 2))
    efficiency = problem.p * (1 - problem.p) / calls / mean_square if mean_square > 0 else math.inf
    calm = f"{covered[~warned].mean():.0%}" if (~warned).any() else "-"
    return (
        f"{count} | {calls:,.0f} | {p.mean() / problem.p - 1:+.1%} | {mean_square**0.5 / problem.p:.1%} | "
        f"{covered.mean():.0%} | {(covered | warned).mean():.0%} | {calm} | {warned.mean():.0%} | {efficiency:.2g}"
    )


def table(done: Runs) -> str:
    lines = [
        "# Calibration of `ce`",
        "",
        "Written by `make calibration` (`tests/bench/ce_calibration.py`, which explains the columns and goes on where",
        "it was interrupted: rows with fewer runs than others are not finished). `ot-*`, `uqpy-*`: OpenTURNS, UQpy.",
        f"Versions: {', '.join(sorted(_versions(done)))}.",
        "",
        f"| {' | '.join(COLUMNS)} |",
        "| --- " * len(COLUMNS) + "|",
    ]
    for problem in PROBLEMS:
        for (name, method, budget), runs in sorted(done.items(), key=lambda item: (item[0][2], item[0][1])):
            if name == problem.name:
                shown = name.replace("|", "\\|")
                lines.append(f"| {shown} | {problem.p:.3g} | {method} | {budget:,} | {rows(problem, runs)} |")
    return "\n".join(lines) + "\n"


def _versions(done: Runs) -> set[str]:
    return {f"{method} {run['version']}" for (_, method, _), runs in done.items() for run in runs}


def read(path: Path, any_version: bool = False) -> Runs:
    """The runs of today's versions of the methods; or all of them, whatever they were made by."""
    done: Runs = defaultdict(list)
    versions: dict[str, str | None] = {}
    for line in path.read_text().splitlines() if path.exists() else ():
        try:
            record = json.loads(line)
        except json.JSONDecodeError:
            continue  # the line being written when the run was stopped
        method = record["method"]
        if not any_version and method not in versions:
            try:
                versions[method] = version(method)
            except (ImportError, KeyError):
                # not to be judged here: a peer that is not installed, a method that is gone
                versions[method] = None
        if any_version or versions[method] in (None, record.get("version")):
            done[record["problem"], method, record["budget"]].append(record)
    return done


def keep(done: Runs, path: Path) -> None:
    """The runs, sorted and packed."""
    lines = [json.dumps(run, sort_keys=True) for key in sorted(done) for run in _by_seed(done[key])]
    path.write_bytes(lzma.compress("".join(line + "\n" for line in lines).encode(), preset=9))


def _by_seed(runs: list[dict[str, Any]]) -> list[dict[str, Any]]:
    return sorted(runs, key=lambda run: run["seed"])


def taken_over(done: Runs, problem: Problem, method: str, budget: int, seed: int) -> dict[str, Any] | None:
    """The run as one that another method has made to the bit."""
    if method != "mixture":
        return None
    same = [r for r in done[problem.name, "auto", budget] if r["seed"] == seed and r["by"] == "mixture"]
    return {name: same[0][name] for name in ("p", "low", "high", "calls", "warned", "by")} if same else None


def sameness(record: dict[str, Any], again: dict[str, Any]) -> str:
    """Whether a run made again is the one on record."""
    if all(record[key] == value for key, value in again.items()):
        return "the same to the bit"
    for key, value in again.items():
        near = isinstance(value, float) and math.isclose(record[key], value, rel_tol=SAME)
        if not (near or record[key] == value):
            return "another result"
    return f"the same to {SAME:g}"


def renewed(path: Path, methods: list[str], show: Callable[[str], None]) -> None:
    """Lines of an earlier version get today's digest where runs made again are the same: the last of each problem below
    LARGE dimensions and of the first above. For changes that were not to change a result. Of several lines of one run
    the last counts."""
    today = {method: version(method) for method in methods}
    every = [json.loads(line) for line in path.read_text().splitlines()]
    lines = list({(r["problem"], r["method"], r["budget"], r["seed"]): r for r in every}.values())
    stale: Runs = defaultdict(list)
    for record in lines:
        if record["version"] != today.get(record["method"], record["version"]):
            stale[record["problem"], record["method"], record["budget"]].append(record)
    small = [problem for problem in PROBLEMS if problem.base.dim < LARGE]
    large = [problem for problem in PROBLEMS if problem.base.dim >= LARGE]
    changed = set()
    for problem in (*small, *large[:1]):
        for (name, method, budget), runs in stale.items():
            if name == problem.name and method not in changed:
                record = _by_seed(runs)[-1]
                again = limited(problem, method, budget, record["seed"])
                said = sameness(record, again)
                show(f"{name:32} {method:10} seed {record['seed']}: {said}")
                changed |= {method} if said == "another result" else set()
    for record in lines:
        if record["method"] in today and record["method"] not in changed:
            record["version"] = today[record["method"]]
    path.write_text("".join(json.dumps(record) + "\n" for record in lines))


def _append(path: Path, line: str) -> None:
    """A line of its own, also where the last one was cut short."""
    cut = path.exists() and path.read_bytes()[-1:] not in (b"", b"\n")
    with path.open("a") as out:
        out.write(("\n" if cut else "") + line + "\n")


def main(arguments: list[str] | None = None, show: Callable[[str], None] = print) -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=200)
    parser.add_argument("--seeds-large", type=int)
    parser.add_argument("--budget", type=int, nargs="+", default=[20_000])
    parser.add_argument("--method", nargs="+", default=list(ce.METHODS))
    parser.add_argument(
        "--problem", nargs="+", default=[""], help="words of which a problem's name holds one"
    )
    parser.add_argument("--results", type=Path, default=Path("build/ce_calibration.jsonl"))
    parser.add_argument("--table", type=Path, default=HERE / "ce_calibration.md")
    parser.add_argument("--keep", action="store_true", help=f"pack the runs into {KEPT.name} at the end")
    parser.add_argument(
        "--renew",
        action="store_true",
        help="first try whether runs of an earlier version are still the same, and take them over",
    )
    given = parser.parse_args(arguments)
    given.results.parent.mkdir(parents=True, exist_ok=True)
    if not given.results.exists() and KEPT.exists():
        given.results.write_bytes(lzma.decompress(KEPT.read_bytes()))
    if given.renew:
        renewed(given.results, given.method, show)
    large = given.seeds if given.seeds_large is None else given.seeds_large
    versions = {method: version(method) for method in given.method}
    done = read(given.results)
    todo = [problem for problem in PROBLEMS if any(word in problem.name for word in given.problem)]
    for first in range(0, max(given.seeds, large), BLOCK):
        for budget in given.budget:
            for problem in todo:
                last = min(first + BLOCK, large if problem.base.dim >= LARGE else given.seeds)
                for method in given.method:
                    runs = done[problem.name, method, budget]
                    had = {r["seed"] for r in runs}
                    begin = SEEDS[problem.name]
                    for seed in sorted(set(range(begin + first, begin + last)) - had):
                        if sum(r["p"] is None for r in runs) >= HOPELESS and runs[-1]["p"] is None:
                            break
                        record = {"problem": problem.name, "method": method, "budget": budget, "seed": seed}
                        made = taken_over(done, problem, method, budget, seed)
                        made = made or limited(problem, method, budget, seed)
                        record |= {"version": versions[method], **made}
                        _append(given.results, json.dumps(record))
                        runs.append(record)
                    if runs and last > first:
                        show(f"{problem.name:32} {method:10} {budget:7} | {rows(problem, runs)}")
            given.table.write_text(table(read(given.results)))
    given.table.write_text(table(read(given.results)))
    if given.keep:
        keep(read(given.results), KEPT)


if __name__ == "__main__":
    main()
