"""Writes the table "Which method" of `ce/README.md` from the kept runs of the calibration.

Run from the repository root: python -m tests.bench.ce_which_method [--results FILE] [--readme FILE]. Seconds. The table
stands between two comments in the README; nothing else there is touched. A cell has the efficiency against naive Monte
Carlo at equal calls of f, training counted, and the share of runs whose interval holds p or that carry a warning; "-"
where it was not run.
"""

import argparse
import lzma
import math
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from tests.bench.ce_calibration import KEPT, PROBLEMS, Runs, read
from tests.reference.problems import Problem

BEGIN, END = "<!-- which method: begin -->", "<!-- which method: end -->"
COLUMNS = ("auto", "mixture", "splitting", "ce", "naive", "ot-nais", "ot-ce", "ot-subset", "uqpy-subset")
BUDGET = 20_000
README = Path(__file__).parents[2] / "ce" / "README.md"


def cell(problem: Problem, runs: list[dict]) -> str:
    """Efficiency and the share of runs that hold p or warn; of a peer that did not end, how often it did not."""
    ended = [r for r in runs if r["p"] is not None]
    if not runs:
        return "-"
    if not ended:
        return f"0 of {len(runs)} end"
    square = float(np.mean([(r["p"] - problem.p) ** 2 for r in ended]))
    calls = float(np.mean([r["calls"] for r in ended]))
    efficiency = problem.p * (1 - problem.p) / calls / square if square > 0 else math.inf
    held = np.mean([r["low"] <= problem.p <= r["high"] or bool(r["warned"]) for r in ended])
    return f"{rounded(efficiency)} / {held:.0%}"


def rounded(value: float) -> str:
    """Two figures, in words that a table can hold: 0.72, 14, 3,400, 2.8e5."""
    if not math.isfinite(value):
        return "inf"
    if value >= 1e5:
        mantissa, exponent = f"{value:.1e}".split("e")
        return f"{mantissa}e{int(exponent)}"
    digits = 1 - math.floor(math.log10(value)) if value > 0 else 0
    return f"{round(value, digits):,.{max(digits, 0)}f}"


def table(done: Runs, columns: tuple[str, ...] = COLUMNS) -> str:
    """One row a problem, with the number of runs of the first method."""
    lines = [
        "| problem | p | runs | " + " | ".join(f"`{name}`" for name in columns) + " |",
        "| --- " * (len(columns) + 3) + "|",
    ]
    for problem in PROBLEMS:
        runs = {name: done.get((problem.name, name, BUDGET), []) for name in columns}
        if any(runs.values()):
            cells = " | ".join(cell(problem, runs[name]) for name in columns)
            name = problem.name.replace("|", "\\|")
            lines.append(f"| {name} | {problem.p:.2g} | {len(runs[columns[0]])} | {cells} |")
    return "\n".join(lines)


def written(text: str, rows: str) -> str:
    """The README's text with the rows between its two comments; ValueError where these are not there."""
    before, begin, rest = text.partition(BEGIN)
    _, end, after = rest.partition(END)
    if not (begin and end):
        raise ValueError(f"the README needs the lines {BEGIN!r} and {END!r} around the table")
    return f"{before}{BEGIN}\n\n{rows}\n\n{END}{after}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--results", type=Path, help=f"runs as JSON lines (the kept ones, {KEPT.name})")
    parser.add_argument("--readme", type=Path, default=README)
    given = parser.parse_args()
    with TemporaryDirectory() as folder:
        path = given.results
        if path is None:
            path = Path(folder) / "runs.jsonl"
            path.write_bytes(lzma.decompress(KEPT.read_bytes()))
        done = read(path, any_version=True)
    given.readme.write_text(written(given.readme.read_text(), table(done)))


if __name__ == "__main__":
    main()
