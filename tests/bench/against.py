"""This checkout's processor time beside that of another commit, in turns, as ratios.

    python -m tests.bench.against --rev 22f7276 --what estimate-idm,estimate-lidar,in-sumo,vision,fixed,whole

The commit is checked out beside (`git worktree`, removed at the end) and run by the same Python with the same
libraries. Each round measures both, one after the other, the first one in turns, so that a machine whose speed varies
slows both; a round's ratio is the other commit's time over this one's: how many times faster this checkout is.
Processor time only: nothing else that runs on the machine counts. Printed are the median of the rounds, their
quartiles, the times of both, and whether f had the same bits.
"""

import json
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import click
import numpy as np

ROOT = Path(__file__).resolve().parents[2]
SIDE = Path(__file__).with_name("against_side.py")
SCENARIO, GAMMA = "i80-paper-10s", "0.7"


@dataclass(frozen=True)
class Rollouts:
    """Rollouts in a process that stays open: `way` is estimate (as an estimate's worker runs them) or sumo."""

    way: str
    ego: str
    a_round: int
    scenario: str = SCENARIO


@dataclass(frozen=True)
class Runs:
    """Whole runs of `tailroad estimate`, with all their processes."""

    budget: int
    workers: int


WHAT: dict[str, Rollouts | Runs] = {
    "estimate-idm": Rollouts("estimate", "idm", 250),
    "estimate-lidar": Rollouts("estimate", "lidar-paper", 250),
    "estimate-human": Rollouts("estimate", "lidar", 250, "i80-10s"),
    "in-sumo": Rollouts("sumo", "lidar-paper", 100),
    "vision": Rollouts("sumo", "vision-paper", 5),
    "fixed": Runs(20, 2),
    "whole": Runs(20_000, 2),
}


@contextmanager
def checked_out(rev: str) -> Iterator[Path]:
    """The commit's files in a folder of their own."""
    with tempfile.TemporaryDirectory(prefix="against-") as folder:
        tree = Path(folder) / "tree"
        _git("worktree", "add", "--quiet", "--detach", str(tree), rev)
        try:
            yield tree
        finally:
            _git("worktree", "remove", "--force", str(tree))


def _git(*words: str) -> None:
    subprocess.run(["git", "-C", str(ROOT), *words], check=True)


def _environment(tree: Path) -> dict[str, str]:
    return os.environ | {"PYTHONPATH": str(tree), "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}


class RolloutSide:
    """Measures rounds of rollouts of one checkout, in a process that stays open."""

    def __init__(self, tree: Path, what: Rollouts, stack: ExitStack):
        self._what = what
        command = [sys.executable, "-P", str(SIDE), what.way, what.scenario, what.ego, GAMMA]
        self._process = stack.enter_context(
            subprocess.Popen(
                command,
                cwd=tree,
                env=_environment(tree),
                text=True,
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
            )
        )

    def measure(self) -> tuple[float, str]:
        """Processor milliseconds a rollout, and a digest of f."""
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._process.stdin.write(f"{self._what.a_round}\n")
        self._process.stdin.flush()
        line = self._process.stdout.readline()
        if not line:
            raise click.ClickException(f"the rollouts of {self._what} ended: see above")
        found = json.loads(line)
        return found["processor_s"] / self._what.a_round * 1e3, found["digest"]


class RunSide:
    """Measures whole runs of one checkout: every process that they start and wait for."""

    def __init__(self, tree: Path, what: Runs, stack: ExitStack):
        self._tree = tree
        rooms = (tree / "service/front").is_dir()
        self._command = [
            sys.executable, "-P", "-m", "service.front.cli" if rooms else "service.cli", "estimate",
            SCENARIO if rooms else "i80-10s", "--ego", "idm", "--gamma", GAMMA, "--method", "naive", "--budget",
            str(what.budget), "--workers", str(what.workers), "--json", "--out",
        ]  # fmt: skip
        self.measure()  # whatever is compiled or made ready once

    def measure(self) -> tuple[float, str]:
        """Processor milliseconds of a run, and what it says of p."""
        with tempfile.TemporaryDirectory(prefix="against-run-") as folder:
            out, said = Path(folder) / "run", Path(folder) / "said"
            with said.open("w") as file:
                process = subprocess.Popen(
                    [*self._command, str(out)], cwd=self._tree, env=_environment(self._tree), stdout=file,
                    stderr=subprocess.DEVNULL,
                )  # fmt: skip
                _, status, used = os.wait4(process.pid, 0)
                process.returncode = os.waitstatus_to_exitcode(status)
            if process.returncode != 0:
                raise click.ClickException(f"{' '.join(self._command)} ended with {process.returncode}")
            return (used.ru_utime + used.ru_stime) * 1e3, repr(json.loads(said.read_text())["p"])


def compare(tree: Path, name: str, rounds: int) -> dict[str, Any]:
    """The row of one question: times of this checkout and of the other, and how their ratio spreads."""
    what = WHAT[name]
    with ExitStack() as stack:
        if isinstance(what, Rollouts):
            sides: list[Any] = [RolloutSide(ROOT, what, stack), RolloutSide(tree, what, stack)]
        else:
            sides = [RunSide(ROOT, what, stack), RunSide(tree, what, stack)]
        times, said = np.empty((rounds, 2)), set()
        for k in range(rounds):
            for side in (0, 1) if k % 2 == 0 else (1, 0):
                times[k, side], answer = sides[side].measure()
                said.add(answer)
        for side in sides:
            if isinstance(side, RolloutSide):
                assert side._process.stdin is not None
                side._process.stdin.close()
    ratios = times[:, 1] / times[:, 0]
    low, middle, high = np.quantile(ratios, [0.25, 0.5, 0.75])
    here, there = np.median(times, axis=0)
    return {
        "what": name, "here_ms": here, "there_ms": there, "ratio": middle, "quartiles": [low, high], "rounds": rounds,
        "same": len(said) == 1,
    }  # fmt: skip


@click.command()
@click.option("--rev", default="22f7276", show_default=True, help="The commit to measure against.")
@click.option("--what", default="estimate-idm,estimate-lidar,in-sumo,vision,fixed", show_default=True,
              help=f"Of {', '.join(WHAT)}.")  # fmt: skip
@click.option("--rounds", default=9, show_default=True, type=click.IntRange(1))
def main(rev: str, what: str, rounds: int) -> None:
    """Measure this checkout against another commit, in turns."""
    names = what.split(",")
    if unknown := [name for name in names if name not in WHAT]:
        raise click.BadParameter(f"{', '.join(unknown)}: give some of {', '.join(WHAT)}", param_hint="--what")
    if shutil.which("git") is None:
        raise click.ClickException("git is needed to check the other commit out")
    with checked_out(rev) as tree:
        click.echo(f"| what | here, ms | {rev}, ms | ratio | quartiles | rounds | same f |")
        click.echo("| --- | --- | --- | --- | --- | --- | --- |")
        for name in names:
            row = compare(tree, name, rounds)
            low, high = row["quartiles"]
            click.echo(
                f"| {name} | {row['here_ms']:.4g} | {row['there_ms']:.4g} | {row['ratio']:.2f} "
                f"| {low:.2f} to {high:.2f} | {rounds} | {'yes' if row['same'] else 'no'} |"
            )


if __name__ == "__main__":
    main()
