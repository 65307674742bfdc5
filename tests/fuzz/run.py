"""The long fuzz run: python -m tests.fuzz.run --payloads 100000 --seed 1 --out build/fuzz (make fuzz).

Rounds of up to 500 payloads, each with its own seed; after each the counts and the memory are written to
OUT/fuzz-SEED.json, and the same command goes on from there. A payload that ends wrongly stops the run and is shown,
made as small as it gets. Memory fails it too: more than MOST_GROWTH_MB that stay after every target's first round, or
a peak beyond MOST_PEAK_MB above it, which is what the scheduler may hold: OPEN_BYTES for open jobs, and as much in each
of its two statistics threads for jobs that are cancelled while they are opened.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import tempfile
from collections import Counter
from pathlib import Path

from hypothesis import HealthCheck, Phase, given, seed, settings
from hypothesis import strategies as st

from tests.fuzz.target import Target
from tests.fuzz.targets import OPEN_BYTES, Targets

ROUND = 500
# payloads of an example: hypothesis takes longer for an example than most payloads for themselves
AT_ONCE = 5
MOST_GROWTH_MB = 64.0
MOST_PEAK_MB = 3 * OPEN_BYTES / 2**20 + MOST_GROWTH_MB
PAGE = os.sysconf("SC_PAGE_SIZE")


def run_round(target: Target, count: int, number: int) -> Counter[str]:
    """How `count` payloads of a target ended, rounded up to a multiple of AT_ONCE."""
    ends: Counter[str] = Counter()

    @seed(number)
    @settings(max_examples=-(-count // AT_ONCE), database=None, deadline=None, suppress_health_check=list(HealthCheck),
              phases=(Phase.generate, Phase.shrink))  # fmt: skip
    @given(st.lists(target.payloads, min_size=AT_ONCE, max_size=AT_ONCE))
    def some(payloads: list[object]) -> None:
        for payload in payloads:
            ends[target.run(payload)] += 1

    some()
    return ends


def memory_mb() -> float:
    """Of this process, resident."""
    return int(Path("/proc/self/statm").read_text().split()[1]) * PAGE / 2**20


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--payloads", type=int, default=100_000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--out", type=Path, default=Path("build/fuzz"))
    asked = parser.parse_args()
    asked.out.mkdir(parents=True, exist_ok=True)
    path = asked.out / f"fuzz-{asked.seed}.json"
    done = json.loads(path.read_text()) if path.exists() else {"rounds": {}, "memory_mb": []}
    memory: list[float] = []  # of this process
    done["memory_mb"].append(memory)
    with tempfile.TemporaryDirectory() as folder, Targets(Path(folder)) as targets:
        rounds = plan(targets.all, asked.payloads)
        for number, (target, count) in enumerate(rounds):
            name = f"{number} {target.name} {count}"
            if name in done["rounds"]:
                continue
            done["rounds"][name] = run_round(target, count, asked.seed * 1_000_003 + number)
            memory.append(round(memory_mb(), 1))
            path.write_text(json.dumps(done, indent=1))
            print(
                f"{number + 1}/{len(rounds)} {target.name}: {dict(done['rounds'][name])}, {memory_mb():.0f} MB",
                flush=True,
            )
        names = [target.name for target in targets.all]
    return _summary(done, names)


def plan(targets: tuple[Target, ...], payloads: int) -> list[tuple[Target, int]]:
    """The rounds, targets in turn, so that memory is seen for all of them from the beginning to the end."""
    left = {t.name: max(1, round(payloads * t.share)) for t in targets}
    rounds = []
    while any(left.values()):
        for target in targets:
            if count := min(ROUND, left[target.name]):
                left[target.name] -= count
                rounds.append((target, count))
    return rounds


def _summary(done: dict, names: list[str]) -> int:
    """Print it; the exit code."""
    total = 0
    for target in names:
        ends: Counter[str] = Counter()
        for name, counts in done["rounds"].items():
            if f" {target} " in f"{name} ":
                ends.update(counts)
        total += sum(ends.values())
        print(f"{target}: {sum(ends.values())} payloads: {dict(ends.most_common())}")
    print(f"{total} payloads, each ended as promised")
    grown = False
    for memory in done["memory_mb"]:  # a process each, where the run was interrupted
        if len(memory) > len(names):
            first, rest = memory[len(names) - 1], memory[len(names) :]
            stayed = min(rest[-len(names) :])  # a peak at the end has not stayed
            grown |= stayed - first > MOST_GROWTH_MB or max(rest) - first > MOST_PEAK_MB
            print(f"resident memory over {len(memory)} rounds: {first} MB after one round of each target, "
                  f"{rest[-1]} MB at the end, {max(memory)} MB at most")  # fmt: skip
    if grown:
        print(
            f"more than {MOST_GROWTH_MB:g} MB have stayed, or there was a peak of more than {MOST_PEAK_MB:g} MB"
        )
    return 1 if grown else 0


if __name__ == "__main__":
    sys.exit(main())
